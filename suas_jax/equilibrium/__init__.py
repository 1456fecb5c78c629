"""The balance of membrane, oil and loads: equations, load path, solution, named outcomes."""
