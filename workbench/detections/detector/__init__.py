"""Detection of people's 2-D joints in videos."""
