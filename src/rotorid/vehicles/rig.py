r"""Roll of the quadrotor on a pivot, as published: a double integrator with two late motors.

The platform turns freely around its center and is driven by motor voltages, sampled at 100 Hz for 120 s
(*frequency-domain identification of a quadrotor with composite windows and K-means clustering*):

.. math:: J_x \ddot\phi = L K_f \left[ u_3(t - \tau_3) - u_4(t - \tau_4) \right]

The input matrix of the whole attitude has these signs; the one printed for roll alone has the opposite ones and
contradicts it. J_x and K_f were published as two numbers, though the roll angle shows their ratio only: 0.457 rad/s² a
volt from the identified pair (0.458 is printed), 0.424 from the documentation of the platform. Delays of some 0.2 s are
long for motors; they hold the transport of the commands too.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from rotorid.models.catalog import library_model
from rotorid.models.state_space import StateSpace

TRUTH: Mapping[str, float] = MappingProxyType(
    {"J_x": 0.047, "K_f": 0.109, "L": 0.197, "tau_3": 0.2279, "tau_4": 0.1770}
)
"""As identified there; SI units and volts."""

DOCUMENTATION: Mapping[str, float] = MappingProxyType({"J_x": 0.0552, "K_f": 0.1188, "L": 0.197})
"""As the documentation of the platform has them."""


def roll() -> StateSpace:
    """Roll angle and rate after the voltages of motors 3 and 4.

    Examples
    --------
    >>> roll().G.round(3)
    array([[ 0.   ,  0.   ],
           [ 0.457, -0.457]])
    """
    return library_model("rig.roll").matrices(TRUTH)
