"""What other machines are told, over OPC UA and MQTT: the page's own answers in their languages."""
