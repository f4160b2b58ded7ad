"""The shared model of a hydraulic manipulator.

Arguments that mean the same in every package, for n joints, m cylinders and N samples:

- `q`, `qd`, `qdd` (n,) or (N, n): joint positions, velocities, accelerations; rad or m, s;
- `qd_r`, `qdd_r`: required velocities and accelerations (eq. 5), of the same shapes;
- `p_a`, `p_b` (m,) or (N, m), `p_s`, `p_t` or `supply`, `tank`: gauge pressures, Pa;
- `x`, `xd`: piston displacement from the retracted end, m, and its velocity;
- `u`: valve signal, voltage over rated voltage; `tau`: joint torques or forces, N m or N;
- `step_s`, `cycle_s`, `dt_s`: sampling interval; `duration_s`, `wait_s`: how long at all;
- `time_s`, `start_s`, `stamp_ns`, `since_ns`: when, on the clock of the samples;
- `index`, `i`, `number`: place in an order, from 0 on, mostly the robot's; `count`: how many;
- `name`, `key`, `unit`, `text`, `comment`: of what is made, read or said, as files spell them;
- `value`, `values`, `default`: what is set or taken, and what stands for it where it is absent;
- `path`, `folder`, `out`: where files lie or go; `out` of kernels: the array that is filled;
- `one`, `other`: the thing asked about, and another of its kind that is compared or merged;
- `seed`, `random`, `rng`: where random numbers start, or come from;
- `arguments`: words of a command line; None: those of the process.
"""

from hydro_model.numerics.compile_cache import use_user_cache

use_user_cache()
