"""Recipes: what users write."""
