"""What is true of gears and nothing else: geometry, flanks, deviations, tolerances, defects."""
