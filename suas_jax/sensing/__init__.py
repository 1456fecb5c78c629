"""From gaps to sensor outputs: taxels, capacitance, electrodes, converter."""
