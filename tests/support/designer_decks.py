"""Decks in the hand of a designer: textbook circuits with op-amps, by name.

Every deck has a title, an input that steps, and an output ``out``. `OPAMP` is a linear macromodel
with one pole, `FAST` one with two poles and an output resistance, `IDEAL` a gain.
"""

from __future__ import annotations

from pathlib import Path

OPAMP = """\
.subckt opamp p n o params: a0=2e5 gbw=1meg
G1 0 x p n 1m
R1 x 0 {a0*1k}
C1 x 0 {1m/(6.283185307179586*gbw)}
E1 o 0 x 0 1
.ends
"""
FAST = """\
.subckt fast p n o params: a0=1e5 gbw=10meg p2=30meg ro=50
Rin p n 2meg
Cin p n 2p
G1 0 x p n 1m
R1 x 0 {a0*1k}
C1 x 0 {1m/(6.283185307179586*gbw)}
G2 0 y x 0 1m
R2 y 0 1k
C2 y 0 {1m/(6.283185307179586*p2)}
E1 z 0 y 0 1
Ro z o {ro}
.ends
"""
STEP = "Vin in 0 DC 0 AC 1 PULSE(0 1 1u 1n 1n 1 2)\n"
END = ".tran 1u 10m\n.end\n"


def deck(title: str, *cards: str, source: str = STEP) -> str:
    """Return a deck with the macromodels that it uses."""
    body = "\n".join(cards)
    models = "".join(
        model for name, model in (("opamp", OPAMP), ("fast", FAST)) if f" {name}" in body
    )
    return f"{title}\n{models}{source}{body}\n{END}"


def written(folder: Path, text: str) -> Path:
    """Return the file of a deck of these lines, to which a title and the end are added."""
    place = folder / "deck.cir"
    place.write_text(f"title\n{text}\n.end\n")
    return place


FILTERS = {
    "sallen-key-low-pass": deck(
        "unity gain, 10 kHz", "R1 in a 10k", "R2 a b 10k", "C1 a out 2.2n", "C2 b 0 1n",
        "X1 b out out opamp gbw=10meg"),
    "sallen-key-ideal": deck(
        "ideal op-amp", "R1 in a 10k", "R2 a b 10k", "C1 a out 2.2n", "C2 b 0 1n",
        "E1 out 0 b out 1e6"),
    "sallen-key-high-pass": deck(
        "capacitors at the source", "C1 in a 10n", "C2 a b 10n", "R1 a out 5k", "R2 b 0 22k",
        "X1 b out out opamp"),
    "sallen-key-gain": deck(
        "gain of 2.5", "R1 in a 10k", "R2 a b 10k", "C1 a out 1n", "C2 b 0 1n", "Rf out m 15k",
        "Rg m 0 10k", "X1 b m out opamp"),
    "sallen-key-fast": deck(
        "with input and output impedance", "R1 in a 4.7k", "R2 a b 4.7k", "C1 a out 330p",
        "C2 b 0 150p", "X1 b out out fast"),
    "mfb-low-pass": deck(
        "multiple feedback", "R1 in a 10k", "R2 a out 10k", "R3 a n 5k", "C1 a 0 10n",
        "C2 n out 1n", "X1 0 n out opamp"),
    "mfb-high-pass": deck(
        "multiple feedback", "C1 in a 10n", "C2 a n 10n", "C3 a out 10n", "R1 a 0 4.7k",
        "R2 n out 22k", "X1 0 n out opamp"),
    "mfb-band-pass": deck(
        "band pass, Q = 5", ".param q=5", "R1 in a {q*10k}", "R2 a 0 1k", "R3 n out {4*q*10k}",
        "C1 a out 1n", "C2 a n 1n", "X1 0 n out opamp"),
    "state-variable": deck(
        "KHN", "R1 in s 10k", "R2 lp s 10k", "R3 hp s 10k", "R4 bp q 27k", "R5 q 0 10k",
        "X1 q s hp opamp", "R6 hp x 10k", "C1 x bp 1n", "X2 0 x bp opamp", "R7 bp y 10k",
        "C2 y lp 1n", "X3 0 y lp opamp", "Eout out 0 lp 0 1"),
    "tow-thomas": deck(
        "biquad", "R1 in a 10k", "R2 a bp 50k", "C1 a bp 1n", "R3 o3 a 10k", "X1 0 a bp opamp",
        "R4 bp b 10k", "C2 b out 1n", "X2 0 b out opamp", "R5 out c 10k", "R6 c o3 10k",
        "X3 0 c o3 opamp"),
    "twin-t-notch": deck(
        "passive T, buffered", "R1 in a 10k", "R2 a b 10k", "C3 a 0 2n", "C1 in c 1n",
        "C2 c b 1n", "R3 c 0 5k", "X1 b out out opamp"),
    "twin-t-active": deck(
        "bootstrapped", ".param k=0.9", "R1 in a 10k", "R2 a b 10k", "C3 a d 2n", "C1 in c 1n",
        "C2 c b 1n", "R3 c d 5k", "X1 b out out opamp", "Rt out t {10k*(1-k)}", "Rb t 0 {10k*k}",
        "X2 t d d opamp"),
    "rc-ladder": deck(
        "four sections", *(f"R{k} {'in' if k == 1 else f'n{k - 1}'} n{k} {k}k\nC{k} n{k} 0 {k}n"
                           for k in range(1, 5)), "Eo out 0 n4 0 1"),
    "lc-low-pass": deck(
        "doubly terminated, fifth order", "Rs in a 50", "C1 a 0 19.67n", "L1 a b 128.8u",
        "C2 b 0 63.66n", "L2 b out 128.8u", "C3 out 0 19.67n", "RL out 0 50"),
    "lc-band-pass": deck(
        "coupled resonators", "Rs in a 10k", "L1 a 0 100u", "C1 a 0 1n", "L2 out 0 100u",
        "C2 out 0 1n", "RL out 0 10k", "K1 L1 L2 0.05"),
    "transformer": deck(
        "with winding resistances", "Rs in a 10", "L1 a 0 10m", "L2 b 0 40m", "K1 L1 L2 0.99",
        "R2 b out 40", "RL out 0 1k", "CL out 0 100p"),
    "all-pass": deck(
        "first order", "R1 in n 10k", "R2 n out 10k", "R3 in p 10k", "C1 p 0 1n",
        "X1 p n out opamp"),
    "bessel-4": deck(
        "two Sallen-Key stages", "R1 in a 10k", "R2 a b 10k", "C1 a m 1.3n", "C2 b 0 1n",
        "X1 b m m opamp gbw=5meg", "R3 m c 10k", "R4 c d 10k", "C3 c out 2.4n", "C4 d 0 900p",
        "X2 d out out opamp gbw=5meg"),
    "ccvs-low-pass": deck(
        "current through a sense source", "R1 in x 1k", "Vs x 0 0", "H1 y 0 Vs -10k",
        "R2 y out 1k", "C1 out 0 10n"),
    "cccs-mirror": deck(
        "mirror into a load", "R1 in x 1k", "Vs x 0 0", "F1 0 out Vs 2", "R2 out 0 5k",
        "C1 out 0 1n", "C2 in x 10p"),
}  # fmt: skip
STAGES = {
    "integrator": deck("leaky", "R1 in n 10k", "C1 n out 10n", "R2 n out 1meg",
                       "X1 0 n out opamp"),
    "integrator-chain-3": deck(
        "three integrators in a loop", "R1 in a 10k", "R0 l3 a 10k", "Rd l1 a 20k", "C1 a l1 1n",
        "X1 0 a l1 opamp", "R2 l1 b 10k", "C2 b l2 1n", "R2d l2 b 40k", "X2 0 b l2 opamp",
        "R3 l2 c 10k", "C3 c l3 1n", "R3d l3 c 30k", "X3 0 c l3 opamp", "Eo out 0 l3 0 1"),
    "differentiator": deck("with a zero", "R1 in a 100", "C1 a n 10n", "R2 n out 10k",
                           "C2 n out 100p", "X1 0 n out opamp"),
    "howland": deck("current source", "R1 in p 10k", "R2 p out 10k", "R3 0 n 10k", "R4 n out 10k",
                    "RL p 0 1k", "CL p 0 100p", "X1 p n out opamp"),
    "improved-howland": deck(
        "with a sense resistor", "R1 in p 10k", "R2 p l 9.9k", "Rs out l 100", "R3 0 n 10k",
        "R4 n out 10k", "RL l 0 500", "CL l 0 1n", "X1 p n out opamp"),
    "instrumentation": deck(
        "three op-amps", "X1 in f1 o1 opamp", "X2 0 f2 o2 opamp", "Rg f1 f2 1k", "R1 o1 f1 10k",
        "R2 o2 f2 10k", "R3 o1 n 10k", "R4 n out 10k", "R5 o2 p 10k", "R6 p 0 10k",
        "X3 p n out opamp"),
    "gyrator": deck(
        "Antoniou's coil in a resonator", "Rs in a 10k", "Cr a 0 10n", "R1 a b 1k", "C2 b c 10n",
        "R3 c d 1k", "R4 d e 1k", "R5 e 0 1k", "X1 a c d fast a0=1e6 gbw=100meg p2=1g",
        "X2 e c b fast a0=1e6 gbw=100meg p2=1g", "Eo out 0 a 0 1"),
    "negative-resistor": deck("NIC", "Rs in a 1k", "R1 a out 1k", "R2 n out 1k", "R3 n 0 2k",
                              "C1 a 0 1n", "X1 a n out opamp gbw=100meg"),
    "transimpedance": deck(
        "photodiode of 50 pF", "Cd n 0 50p", "Rf n out 100k", "Cf n out 0.5p",
        "X1 0 n out fast gbw=50meg", source="Ipd n 0 DC 0 PULSE(0 1u 1u)\n"),
    "transimpedance-uncompensated": deck(
        "rings", "Cd n 0 100p", "Rf n out 1meg", "X1 0 n out opamp gbw=10meg",
        source="Ipd n 0 DC 0 PULSE(0 0.1u 1u)\n"),
    "follower-capacitive": deck(
        "capacitive load", "X1 in o o opamp", "Ro o out 100", "CL out 0 10n"),
    "follower-loaded": deck("behind its resistance", "X1 in out out fast ro=100", "CL out 0 1n",
                            "RL out 0 2k"),
    "isolated-load": deck(
        "with feedback inside and outside", "X1 in n o fast", "Riso o out 50", "CL out 0 10n",
        "Rf out n 10k", "Cf o n 100p"),
    "inverting": deck("with stray capacitance", "R1 in n 100k", "R2 n out 1meg", "Cs n 0 5p",
                      "Cf n out 0.3p", "X1 0 n out fast"),
    "composite": deck(
        "an amplifier within another's loop", "R1 in n 1k", "R2 n out 100k", "Cf n out 1p",
        "X1 0 n m opamp gbw=1meg", "R3 m n2 1k", "R4 n2 0 1k", "X2 m n2 out fast"),
    "floating-supply": deck(
        "sources between nodes", "R1 in a 1k", "Vb b a 1.5", "R2 b c 2k", "C1 b 0 1n",
        "E1 d c a 0 0.5", "R3 d out 1k", "C2 out c 2n", "R4 out 0 10k"),
    "servo": deck("PI control of an RC plant", "E1 e 0 in out 1", "Rp e n 10k", "Cp x out2 100n",
                  "Rz n x 20k", "X1 0 n out2 opamp", "Ei i 0 out2 0 -1", "R1 i b 1k",
                  "C1 b 0 1u", "R2 b out 10k", "C2 out 0 100n"),
    "charge-amplifier": deck(
        "piezo sensor", "Cs in n 1n", "Cf n out 100p", "Rf n out 100meg", "X1 0 n out opamp"),
    "bootstrapped": deck(
        "follower with a bootstrapped bias", "C1 in p 1u", "R1 p b 100k", "R2 b 0 100k",
        "C2 out b 10u", "X1 p out out opamp"),
    "difference": deck("with mismatch", "R1 in n 10k", "R2 n out 10k", "R3 in p 10.1k",
                       "R4 p 0 10k", "C1 p 0 10p", "X1 p n out opamp"),
    "lead-lag": deck(
        "compensated comparator", "R1 in n 10k", "Rx n x 1k", "Cx x 0 1n", "R2 n out 100k",
        "X1 0 n out fast"),
    "guarded-line": deck(
        "sensor behind a cable", "Rs in a 1meg", "Cc a g 100p", "Cg g 0 200p", "X1 a out out fast",
        "Rg out g 100"),
    "current-feedback": deck(
        "as a linear model", "Ri n p 50", "Vs p2 p 0", "Rs in p2 1", "F1 0 z Vs 1", "Rz z 0 1meg",
        "Cz z 0 1p", "E1 out 0 z 0 1", "Rf out n 1k", "Rg n 0 1k"),
}  # fmt: skip
OSCILLATORS = {
    "wien": deck(
        "gain from a parameter", ".param gain=2.9", "R1 out x 10k", "C1 x p 10n", "R2 p 0 10k",
        "C2 p 0 10n", "E1 out 0 p 0 {gain}", source="I1 0 p PULSE(0 1u)\n"),
    "wien-resistors": deck(
        "gain from resistors", "R1 out x 10k", "C1 x p 10n", "R2 p 0 10k", "C2 p 0 10n",
        "E1 out 0 p n 1e9", "Rf out n 19k", "Rg n 0 10k", source="I1 0 p PULSE(0 1u)\n"),
    "phase-shift": deck(
        "three equal sections", ".param gain=25", "C1 out a 10n", "R1 a 0 10k", "C2 a b 10n",
        "R2 b 0 10k", "C3 b c 10n", "R3 c 0 10k", "E1 out 0 0 c {gain}",
        source="I1 0 b PULSE(0 1u)\n"),
    "phase-shift-low": deck(
        "three low-pass sections", ".param gain=25", "R1 out a 10k", "C1 a 0 10n", "R2 a b 10k",
        "C2 b 0 10n", "R3 b c 10k", "C3 c 0 10n", "E1 out 0 0 c {gain}",
        source="I1 0 b PULSE(0 1u)\n"),
    "colpitts": deck(
        "linear transistor", ".param gm=1m", "L1 c 0 10u", "C1 c e 1n", "C2 e 0 1n",
        "G1 c e 0 e {gm}", "Re e 0 10k", "Rl c 0 10k", "Eo out 0 c 0 1",
        source="I1 0 e PULSE(0 1u)\n"),
    "quadrature": deck(
        "two integrators", "R1 q a 10k", "C1 a out 10n", "E1 out 0 0 a 1e6", "R2 out b 10k",
        "C2 b i 10n", "E2 i 0 0 b 1e6", "E3 q 0 0 i 0.99", "Rd a out 200k",
        source="I1 0 b PULSE(0 1u)\n"),
    "ring": deck(
        "three inverters", ".param gain=1.9", *(
            f"R{k} {'out' if k == 3 else f'o{k}'} {'n1' if k == 3 else f'n{k + 1}'} 10k\n"
            f"C{k} {'n1' if k == 3 else f'n{k + 1}'} 0 100p\n"
            f"E{k} {'out' if k == 3 else f'o{k}'} 0 0 n{k} {{gain}}" for k in (1, 2, 3)),
        source="I1 0 n2 PULSE(0 1u)\n"),
}  # fmt: skip
CLOSED_FORMS = {
    "howland-ideal": deck(
        "current source of 1 / R2 into a load, with an op-amp of gain 1e6", "R1 in p 10k",
        "R2 p o 10k", "R3 0 n 10k", "R4 n o 10k", "E1 o 0 p n 1e6", "RL p out 1", "CL out 0 1n",
        "Rl2 out 0 2k"),
    "howland-unbalanced": deck(
        "one resistor is 5 % too large", "R1 in p 10k", "R2 p o 10.5k", "R3 0 n 10k", "R4 n o 10k",
        "E1 o 0 p n 1e6", "RL p out 1", "CL out 0 1n", "Rl2 out 0 2k"),
    "howland-capacitor": deck(
        "compensated", "R1 in p 100k", "R2 p out 100k", "R3 0 n 100k", "R4 n out 100k",
        "C4 n out 10p", "RL p 0 10k", "CL p 0 1n", "X1 p n out fast"),
    "instrumentation-two": deck(
        "two op-amps", "R1 0 a 90k", "R2 a o1 10k", "X1 0 a o1 fast", "R3 o1 b 10k",
        "R4 b out 90k", "Rg a b 20k", "X2 in b out fast"),
    "instrumentation-filtered": deck(
        "with an input filter and a guarded difference stage", "Rf1 in p1 1k", "Rf2 0 p2 1k",
        "Cd p1 p2 10n", "Cc1 p1 0 1n", "Cc2 p2 0 1n", "X1 p1 f1 o1 opamp", "X2 p2 f2 o2 opamp",
        "Rg f1 f2 499", "R1 o1 f1 24.9k", "R2 o2 f2 24.9k", "R3 o1 n 10k", "R4 n out 10k",
        "R5 o2 p 10k", "R6 p 0 10k", "X3 p n out opamp"),
    "gyrator-two-sources": deck(
        "L = C / (g1 g2) = 10 mH beside 1 nF", "Rs in out 10k", "C1 out 0 1n", "G1 0 b out 0 1m",
        "C2 b 0 10n", "G2 out 0 b 0 1m"),
    "gyrator-follower": deck(
        "a simulated coil with a series resistance", "Rs in out 1k", "C1 out 0 10n", "Rl out f 100",
        "Cg out g 100n", "Rg g 0 100k", "X1 g f f opamp gbw=100meg"),
    "transimpedance-closed": deck(
        "1 pole in the op-amp, Cd + Cf at its input", ".param a0=1e5 w=6.283185307179586e7",
        "Cd n 0 40p", "Rf n out 100k", "Cf n out 0.4p", "G1 0 x 0 n 1m", "Rx x 0 {a0*1k}",
        "Cx x 0 {1m/w}", "E1 out 0 x 0 1", source="Ipd n 0 DC 0 PULSE(0 1u 1u)\n"),
    "transimpedance-tee": deck(
        "a T in the place of a large resistor", "Cd n 0 20p", "R1 n t 1meg", "R2 t out 10k",
        "R3 t 0 1.1k", "Cf n out 0.2p", "X1 0 n out fast",
        source="Ipd n 0 DC 0 PULSE(0 0.1u 1u)\n"),
    "integrator-deboo": deck(
        "non-inverting", "R1 in p 10k", "R2 p out 10k", "C1 p 0 10n", "R3 n 0 10k", "R4 n out 9.9k",
        "X1 p n out opamp"),
    "notch-bainter": deck(
        "three op-amps", "R1 in a 10k", "R2 a hp 10k", "X1 0 a hp opamp", "R3 hp b 20k",
        "C1 b lp 1n", "X2 0 b lp opamp", "R5 lp c 20k", "C2 c in2 1n", "Ein in2 0 hp 0 1",
        "R6 out a 40k", "R4 c 0 100k", "X3 c out out opamp"),
    "allpass-delay": deck(
        "two first-order sections", "R1 in n1 10k", "R2 n1 m 10k", "R3 in p1 10k", "C1 p1 0 1n",
        "X1 p1 n1 m opamp", "R4 m n2 10k", "R5 n2 out 10k", "R6 m p2 22k", "C2 p2 0 1n",
        "X2 p2 n2 out opamp"),
}  # fmt: skip
"""Sources, amplifiers and simulated coils; `test_foreign_board` has the closed forms of some."""
DECKS = FILTERS | STAGES | OSCILLATORS | CLOSED_FORMS
