"""Where stations and elements lie along the arc, and which element carries which load."""
