"""Why a person was lost: what would have held them."""
