"""What an operator does: check the devices, turn, record, stop safe, recover."""
