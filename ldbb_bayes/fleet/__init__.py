"""Analysis of many campaigns: of a shop floor, one machine over time, or a series of machines."""
