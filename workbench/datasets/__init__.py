"""Where frames and truth come from: rendered scenes and real video."""
