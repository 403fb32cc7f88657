"""What LAFlattening does with MRML nodes: surfaces, seeds, maps, views. No Qt; the method is in LAFlatteningLib."""
