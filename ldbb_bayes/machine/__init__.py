"""What the machine is: its chain, its exact readings, its Jacobians."""
