"""Ports that deliver bytes: serial, network socket, CAN bus."""
