"""Studies track nobody: they show what is learned from motion, and what a prior draws."""
