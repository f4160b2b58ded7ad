"""The diagnosis: what physics a model leaves out. Residuals, locate, name, model, verify.

Shared arguments: `term`, `terms`: effects with their targets and parameters; `whole`: the model
with everything that was found, as fitted; `work`: rows, bases and model that all steps share;
`columns`, `offset`: what a linear fit is made of, and what is taken off first; `seen`: the values
of a variable in its own rows; `chosen`: numbers of what is looked at; `without`, `current`: the
model before one more effect; `best`: the trial that scores highest; `coefficients`: those of a
trial's columns; `p`, `p_value`: chance of as much without an effect; `size`: how many rows there
are; `guard_s`: time beside a held-out block that is fitted neither.
"""
