"""The lumped thin shell in plane strain."""
