"""The model as an FMI 2.0 co-simulation slave of PythonFMU."""

from __future__ import annotations

from types import MappingProxyType
from typing import Any
from xml.etree.ElementTree import SubElement

from pythonfmu import DefaultExperiment, Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

from hapticd.export.plain.axis import Axis
from hapticd.export.plain.model import MODEL, PERIOD_S


class HapticdAxis(Fmi2Slave):
    """Takes a command at every communication step, and moves the axis through it."""

    description = "An axis by hapticd: a current is commanded, and it moves. The target needs Python 3.9 or later."
    default_experiment = DefaultExperiment(start_time=0.0, step_size=PERIOD_S)

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.command = self.external = self.initial_position = self.initial_velocity = 0.0
        self.x = self.v = self.i = self._now = 0.0
        self._axis = Axis(MODEL)
        for name, text in (("initial_position", "rad or m"), ("initial_velocity", "rad/s or m/s")):
            self.register_variable(
                Real(name, causality=Fmi2Causality.parameter, variability=Fmi2Variability.fixed, description=text)
            )
        self.register_variable(Real("command", causality=Fmi2Causality.input, description="commanded current, A"))
        self.register_variable(Real("external", causality=Fmi2Causality.input, description="torque or force, N m or N"))
        for name, text in (
            ("position", "true position, rad or m"),
            ("velocity", "rad/s or m/s"),
            ("current", "in the motor, A"),
            ("measured", "position that the encoder sees, before it is counted"),
        ):
            self.register_variable(
                Real(name, causality=Fmi2Causality.output, description=text, getter=self._getter(name))
            )

        for name, text in (("x", "position, rad or m"), ("v", "velocity, rad/s or m/s"), ("i", "motor's current, A")):
            self.register_variable(
                Real(name, causality=Fmi2Causality.input, description=f"of the output torque: {text}")
            )
        self.register_variable(
            Real(
                "torque",
                causality=Fmi2Causality.output,
                description="what accelerates the inertia at x, v and i, N m or N",
                getter=lambda: self._axis.torque(self.x, self.v, self.i, self._now),
            )
        )

    def _getter(self, name: str) -> Any:
        return lambda: getattr(self._axis, name)

    def to_xml(self, model_options: Any = MappingProxyType({})) -> Any:
        """With the outputs named as unknown at first, which FMI asks for and PythonFMU leaves out."""
        root = super().to_xml(model_options)
        unknowns = SubElement(root.find("ModelStructure"), "InitialUnknowns")
        for output in root.iterfind("ModelStructure/Outputs/Unknown"):
            SubElement(unknowns, "Unknown", output.attrib)
        return root

    def exit_initialization_mode(self) -> None:
        """Begin from the initial state."""
        self._axis = Axis(MODEL, self.initial_position, self.initial_velocity)

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Give the command, and move through the step."""
        self._axis.external = self.external
        self._axis.step(self.command, step_size)
        self._now = current_time + step_size
        return True
