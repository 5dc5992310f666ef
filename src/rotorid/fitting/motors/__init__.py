"""Inertia, thrust, motor lag and torque from motor outputs."""
