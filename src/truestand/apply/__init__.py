"""A calibration and another scan: does it hold, where is the part."""
