"""Sensors and tables: pure codecs in ``wire/``, connections, drivers. They never import the virtual stand."""
