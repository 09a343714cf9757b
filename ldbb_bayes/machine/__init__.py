"""Model of the machine: kinematic chain, exact readings of circles, and Jacobians."""
