"""Sets of states of linear groups as polytopes, and the claims proved with them."""
