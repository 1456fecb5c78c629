"""Reports described once, for a terminal and as pages of HTML that need nothing else."""
