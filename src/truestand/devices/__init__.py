"""Sensors and tables: pure codecs in ``wire/``, connections, drivers. It never imports the virtual stand."""
