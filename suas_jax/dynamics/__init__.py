"""Motion about a state: inertia and viscosity of the oil's film, added mass of the water."""
