"""Numbers in, numbers out: no files, clock, network, logging or plots."""
