"""Features and their form: association, zones, filters."""
