"""Figures and field files of solved scenes."""
