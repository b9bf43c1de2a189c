"""Chamber: volume, compressibility and pressure rate, Eq. 3.5-3.7.

    dP1/dt = (sum Q - A1 v) / (V/E(P) + C_hose),   V = max(A1 y + V_pl, floor)

With entrained air (volume fraction alpha at atmospheric pressure, polytropic n = 1.4, absolute pressure P):
    1/E(P) = (1/E + alpha (P0/P)^(1/n) / (n P)) / (1 + alpha (P0/P)^(1/n))
No negative absolute pressure: below CAVITATION_SOFT above absolute zero, a falling rate fades out.
"""

from hexsim.compiled import compiled

ATMOSPHERE = 1.01325e5  # [Pa]; pressures are gauge, absolute zero is -ATMOSPHERE
CAVITATION_SOFT = 2.0e4  # [Pa] a falling pressure rate fades out over this above absolute zero
VOLUME_FLOOR = 1.0e-6  # [m3] smallest chamber volume, reached only at the end stop
AIR_EXPONENT = 1.4  # [-] adiabatic: bubbles are compressed faster than they exchange heat


@compiled
def volume(y, area, dead_volume):
    """Oil volume [m3] at piston position y."""
    return max(y * area + dead_volume, VOLUME_FLOOR)


@compiled
def bulk_modulus(pressure, oil_modulus, air_fraction):
    """Effective bulk modulus [Pa] of oil with entrained air at gauge pressure `pressure`."""
    if air_fraction <= 0.0:
        return oil_modulus
    absolute = max(pressure + ATMOSPHERE, CAVITATION_SOFT)
    air = air_fraction * (ATMOSPHERE / absolute) ** (1.0 / AIR_EXPONENT)
    return (1.0 + air) / (1.0 / oil_modulus + air / (AIR_EXPONENT * absolute))


@compiled
def capacity(oil_volume, pressure, oil_modulus, air_fraction, hose_compliance):
    """Hydraulic capacity V/E + C_hose [m3/Pa]."""
    return oil_volume / bulk_modulus(pressure, oil_modulus, air_fraction) + hose_compliance


@compiled
def pressure_rate(net_flow, chamber_capacity, pressure):
    """dP/dt [Pa/s] from the net flow into the chamber, Eq. 3.7; never through absolute zero."""
    rate = net_flow / chamber_capacity
    if rate < 0.0:
        rate *= min(max((pressure + ATMOSPHERE) / CAVITATION_SOFT, 0.0), 1.0)
    return rate


@compiled
def slowdown(slope, chamber_capacity):
    """By what dP/dt is divided in a step h [s] of a chamber whose net flow falls by slope/h [m3/s/Pa] with its pressure."""
    return 0.5 * slope / chamber_capacity if slope > 2.0 * chamber_capacity else 1.0
