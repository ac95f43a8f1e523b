"""Engines, reference solvers, measures, verdicts, studies and reports."""
