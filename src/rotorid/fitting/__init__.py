"""Problems, costs and local solvers."""
