"""From points to teeth and flanks."""
