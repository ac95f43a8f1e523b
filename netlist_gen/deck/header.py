"""The comment lines at the head of a deck: scene, units, scalings and omitted parts."""

from __future__ import annotations

from taction.netlist_gen.board.circuit import Circuit


def header_lines(circuit: Circuit) -> list[str]:
    """Return the header of `circuit` as SPICE comments.

    Its only text by the user is the scene's name: letters, digits and ``-_.`` only.
    """
    s = circuit.scalings
    sensors, channels = circuit.matrices[0].ohms.shape
    lines = [
        f"scene {circuit.name}: {channels} channels, {sensors} sensors,"
        f" {circuit.amplifier} amplifiers, topology {circuit.topology}",
        "units: ohm, F, V, A, s; values are plain floats",
        f"G0 = {s.unit_conductance!r} S   (T = 1 is this conductance: R_kn = 1/(|T_kn| G0))",
        f"U0 = {s.unit_voltage!r} V   (u = 1 is this voltage at an output)",
        f"R = {s.resistance!r} ohm, C = {s.capacitance!r} F, s = {s.gain!r} ohm",
        f"lambda = {s.lam!r}",
    ]
    if circuit.has_nonlinear_amplifiers:
        lines.append(f"Ve = {s.exponential_slope!r} V   (u = U0 g(v/Ve))")
    outputs = ", ".join(
        f"u_{n} = {'-' if out.sign < 0 else ''}v({out.node})"
        for n, out in enumerate(circuit.outputs[:3], 1)
    )
    lines.append("outputs: " + outputs + (", ..." if len(circuit.outputs) > 3 else ""))
    lines.append("Rf_k_n, Rb_k_n: forward and feedback resistor of row k, column n of T")
    lines += [f"left out: {item.what}; {item.why}" for item in circuit.omissions]
    return ["* " + line for line in lines]
