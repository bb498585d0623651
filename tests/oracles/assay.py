"""Statistics of scipy for the tests of carved-core's assay: prints what `crates/core/src/assay` is compared with.

Needs numpy and scipy (tests/oracles/requirements-assay.txt). Run it with no argument to print the values; the tests hold them.
"""

import json

import numpy as np
from scipy import optimize, stats

AT = [0.0, 0.5, 2.5, 30.0]
SAMPLE = [2.1, 3.4, 1.9, 5.6, 2.2, 3.0]


def summary(values):
    x = np.array(values)
    low, high = stats.t.interval(0.95, len(x) - 1, x.mean(), stats.sem(x))
    return {
        "mean": x.mean(),
        "sd": x.std(ddof=1),
        "low": low,
        "high": high,
        "median": np.median(x),
        "mad": stats.median_abs_deviation(x),
    }


def curve(dose, a, b, log10_ec50, ln_hill):
    with np.errstate(divide="ignore"):
        return a + (b - a) / (1 + (10.0**log10_ec50 / dose) ** np.exp(ln_hill))


def dose_response(points, start):
    """The fit of scipy, with the interval of each parameter and the F test against the mean."""
    dose, y = np.array(points).T
    found, covariance = optimize.curve_fit(curve, dose, y, p0=start, method="lm", xtol=1e-15, ftol=1e-15, maxfev=100000)
    n = len(y)
    rest = ((y - curve(dose, *found)) ** 2).sum()
    total = ((y - y.mean()) ** 2).sum()
    f = ((total - rest) / 3) / (rest / (n - 4))
    a, b, log10_ec50, ln_hill = found
    sd = np.sqrt(np.diag(covariance))
    # scipy's own differences of the curve by its parameters.
    slopes = [optimize.approx_fprime(found, lambda of: curve(np.array([at]), *of)[0], 1e-7 * np.abs(found)) for at in AT]
    return {
        "at_zero": [a, sd[0]],
        "at_infinity": [b, sd[1]],
        "log10_ec50": [log10_ec50, sd[2]],
        "hill": [np.exp(ln_hill), sd[3] * np.exp(ln_hill)],
        "t": stats.t.ppf(0.975, n - 4),
        "residual_sd": np.sqrt(rest / (n - 4)),
        "p": stats.f.sf(f, 3, n - 4),
        "at": [[at, curve(np.array([at]), *found)[0], np.sqrt(s @ covariance @ s)] for at, s in zip(AT, slopes)],
    }


# Volumes of larvae, um^3: three per dose in uM, with a zero dose; normal scatter of 4 % about 3.1e8 -> 1.9e8 at 2.5 uM, h = 1.4.
FALLING = [
    [dose, round(curve(dose, 3.1e8, 1.9e8, np.log10(2.5), np.log(1.4)) * (1 + 0.04 * shift), -4)]
    for dose, shifts in [
        (0.0, [0.31, -0.92, 0.44]),
        (0.1, [-0.21, 1.02, -0.77]),
        (0.3, [0.65, -1.31, 0.12]),
        (1.0, [-0.48, 0.87, 1.44]),
        (3.0, [-1.06, 0.29, 0.53]),
        (10.0, [0.71, -0.34, -1.18]),
        (30.0, [0.08, 1.27, -0.59]),
    ]
    for shift in shifts
]
# One value per dose, a rising response without a dose of 0.
RISING = [[1, 10.2], [2, 10.9], [4, 14.1], [8, 22.8], [16, 33.9], [32, 38.6], [64, 40.3], [128, 39.7]]

if __name__ == "__main__":
    print(json.dumps({
        "summary": summary(SAMPLE),
        "falling_points": FALLING,
        "falling": dose_response(FALLING, [3e8, 2e8, 0.4, 0.0]),
        "rising": dose_response(RISING, [10, 40, 0.9, 0.7]),
    }, indent=1))
