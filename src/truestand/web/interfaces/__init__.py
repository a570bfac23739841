"""Interfaces for other machines, OPC UA and MQTT: the answers of the page's routes in their protocols."""
