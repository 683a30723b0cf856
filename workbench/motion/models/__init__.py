"""Models learned from motion libraries."""
