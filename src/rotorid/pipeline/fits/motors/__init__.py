"""Motors: inertia, thrust, lag and torque from records of motors, with what their intervals hold."""
