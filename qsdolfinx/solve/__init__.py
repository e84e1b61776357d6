"""The nonlinear problem and how it is solved."""
