"""Other ways of laying the left atrium flat, to compare ours with; each says its source and how it deviates from it."""
