"""Many runs: their plan, a process for each, and what a person sees of them."""
