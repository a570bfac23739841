"""Records: what truestand writes and reads again."""
