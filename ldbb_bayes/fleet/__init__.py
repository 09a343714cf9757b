"""Many campaigns: a shop floor, a year, a builder's whole series."""
