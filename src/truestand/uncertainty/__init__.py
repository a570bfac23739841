"""The budget, from sensitivities that the rooms above bring."""
