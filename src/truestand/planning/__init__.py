"""Where to put the sensors: what each place shows of a part, and how well it could be measured from there."""
