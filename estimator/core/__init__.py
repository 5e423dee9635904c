"""The core: model, flow, filter, control law and scan in C (the headers beside this file), and their Python side."""
