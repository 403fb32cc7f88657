"""From a raw atrium to the open cavity that is flattened."""
