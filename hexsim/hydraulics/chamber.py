"""Chamber: volume, compressibility, pressure and the void that opens at vapour pressure, Eq. 3.5-3.7.

    dP1/dt = (sum Q - A1 v) / C,   C = V/E(P) + C_hose,   V = max(A1 y + V_pl, floor)

With entrained air (volume fraction alpha at atmospheric pressure P0, absolute pressure P):
    1/E(P) = (1/E + alpha (P0/P) / (n P)) / (1 + alpha P0/P)

Air in oil has that oil's temperature: on its way from the tank, and over seconds, its volume follows Boyle, alpha P0/P.
About it a ripple of the pressure is too fast for bubbles to give off heat and is adiabatic, n = 1.4 (Merritt 1967, 1-4:
1/E = 1/E_oil + V_gas/V_total / (n P)). Air that was compressed adiabatically from P0 on would be (P/P0)^(1 - 1/n) as large:
2 at 11 bar, 2.8 at 35 bar, 3.4 at 70 bar.
Dissolving: alpha is what is free. Mineral oil holds 9 % of its volume in solution at P0 and in proportion more under
pressure (Bunsen coefficient 0.09, Henry), so that at working pressure all free air dissolves in time, in seconds to
minutes by the size of its bubbles, and comes out again in the tank. No such time is in the model: an identified alpha is that
of the log's minutes. A swing of the pressure by a factor s within a second is off by s^(1 - 1/n) of the air's share.

Oil bears no tension: at its vapour pressure P_v it leaves a void W behind, and stays at P_v until inflow or a smaller
chamber has closed it,

    dW/dt = A1 v - sum Q

A chamber has one state s for both, in Pa: the pressure while oil fills it, and below P_v the pressure that its oil would
have if it could bear tension, which stands for the void:

    P = max(s, P_v),   W = (P_v - s) C(P_v) for s < P_v
    C ds/dt = sum Q - A1 v + max(P_v - s, 0) dC/dt

So no oil is made or lost, dP/dt alone jumps, and a void that closes at speed ends in a rise of pressure.
Limits: the void is vapour alone. Air that leaves the solution, and takes seconds to return, is not in it.
"""

from hexsim.compiled import compiled
from hexsim.declaration import ATMOSPHERE_Pa

VAPOUR = 10.0 - ATMOSPHERE_Pa  # [Pa] gauge; mineral oils boil at 0.1 to 10 Pa absolute at 20 to 60 degC
VOLUME_FLOOR = 1.0e-6  # [m3] smallest chamber volume, reached only at the end stop


@compiled
def volume(y, area, dead_volume):
    """Oil volume [m3] at piston position y."""
    return max(y * area + dead_volume, VOLUME_FLOOR)


@compiled
def bulk_modulus(pressure, oil_modulus, air_fraction):
    """Effective bulk modulus [Pa] of oil with entrained air, for a ripple about the gauge pressure `pressure`.

    A ripple is adiabatic (1.4): it is faster than bubbles exchange heat. Below 20 kPa absolute air swells at the rate that it has
    there, and vapour soon does the rest.
    """
    if air_fraction <= 0.0:
        return oil_modulus
    absolute = max(pressure + ATMOSPHERE_Pa, 2.0e4)
    air = air_fraction * ATMOSPHERE_Pa / absolute
    return (1.0 + air) / (1.0 / oil_modulus + air / (1.4 * absolute))


@compiled
def capacity(oil_volume, pressure, oil_modulus, air_fraction, hose_compliance):
    """Hydraulic capacity V/E + C_hose [m3/Pa]."""
    return oil_volume / bulk_modulus(pressure, oil_modulus, air_fraction) + hose_compliance


@compiled
def pressure(state):
    """Pressure [Pa] of a chamber in this state: never below that of vapour."""
    return max(state, VAPOUR)


@compiled
def void(state, capacity_at_vapour):
    """Volume [m3] of vapour in a chamber in this state."""
    return max(VAPOUR - state, 0.0) * capacity_at_vapour


@compiled
def state_rate(state, net_flow, room, room_rate=0.0):
    """ds/dt [Pa/s] for what flows in less what the piston sweeps [m3/s], Eq. 3.7. room: C [m3/Pa] at P(s); room_rate: dC/dt."""
    rate = net_flow / room
    if state < VAPOUR:
        rate += (VAPOUR - state) * room_rate / room
    return rate


@compiled
def slowdown(slope, room):
    """By what the net flow is divided in a step h [s] of a chamber whose net flow falls by slope/h [m3/s/Pa] with its pressure."""
    return slope / room if slope > room else 1.0


@compiled
def slowed(net_flow, state, room, slower, h):
    """Net flow [m3/s] of a chamber whose pressure is faster than the step h [s], divided by `slower`.

    The pressure of a void does not answer to flow: what closes it within the step counts in full, the rest is divided.
    """
    if slower <= 1.0:
        return net_flow
    closing = void(state, room) / h
    if closing > 0.0 and net_flow <= closing:
        return net_flow
    return closing + (net_flow - closing) / slower
