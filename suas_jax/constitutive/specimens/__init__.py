"""Test specimens with closed forms: homogeneous deformations, balloon, tube, diaphragm."""
