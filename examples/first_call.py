"""Weigh a robot's links from the log of a walk: one call.

python examples/first_call.py
"""

import massid


def main() -> massid.Result:
    """Weigh the sample walk's robot, and say what the call says while it works."""
    result = massid.weigh(
        massid.sample_walk(),
        robot="atlas",
        links=["torso", "l_thigh", "r_thigh", "l_calf", "r_calf", "l_foot", "r_foot"],
        progress=lambda fraction, what: print(f"{fraction:4.0%} {what}") if what == "judging" else None,
        tell=lambda said: print(said) if isinstance(said, str) else None,
    )
    for link, mass_kg in result.estimate_kg.items():
        print(f"{link}: {result.nominal_kg[link]:.2f} kg in the model file, {mass_kg:.2f} kg found")
    return result


if __name__ == "__main__":
    main()
