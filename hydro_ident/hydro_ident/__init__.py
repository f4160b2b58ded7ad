"""Identification of a hydraulic manipulator from recorded bags.

Arguments are named as in `hydro_model`; besides, everywhere here:

- `found`: what identification, diagnosis or a study found, as its type says;
- `signals`: the sensors as a survey of the recordings saw them: noise, steps, spikes;
- `moved`: the motion at which force columns are taken, derivatives included;
- `joints`: the joints' names, in the robot's order; `std`: standard deviation of a value;
- `theta`: parameters, one for each column of a regressor; `dof`: degrees of freedom, of a
  robot its joints;
- `noise_floor`: residual that the sensors' noise alone leaves, in the channel's unit;
- `mask`, `index` of rows: which are meant; `run`: a recorded or simulated run.
"""
