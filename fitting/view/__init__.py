"""The skin in a browser: a page served from this machine, for scenes, logs and live ports."""
