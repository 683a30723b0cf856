"""Studies without tracking: learned motion models, and samples of priors."""
