"""The settings of the rule, and the sizes of its models, which follow from the robot's body."""

import dataclasses
from collections.abc import Mapping
from typing import Any, NamedTuple, Self

from pipeline.learner.body import AXES, TURNS, Body, any_body
from pipeline.learner.rule import Settings, Shown
from pipeline.learner.rules.forward_inverse.features import (
    MAX_FEATURES,
    count_features,
    largest_degree,
    make_features,
    product_name,
)
from recorders.errors import ConfigError
from recorders.messages.phase import EVALUATE, LEARN
from recorders.text.wording import value_text

MAX_DEGREE = 5
_SUMS = ("sum of weights", "leverage", "leverage^2", "samples")
RESIDUAL = "residual"
RESIDUAL_DEGREE = 2
"""Of the residual of a controller that goes on learning while it serves: 28 features for two hands."""


class ModelSize(NamedTuple):
    """One model of the rule: what it depends on, up to which degree, and what it gives."""

    name: str
    variables: tuple[int, ...]  # places of inputs, or of joints
    degree: int
    features: int
    outputs: int


@dataclasses.dataclass(frozen=True, kw_only=True)
class ForwardInverseConfig(Settings):
    """Settings of the inverse estimate g, of the forward models F and of their residual, by recursive least squares.

    Parameters
    ----------
    inputs, outputs : int
        Three inputs for each hand, six if its pose is controlled; outputs are the inputs and the joints.
    epochs : int
        How often a log is learned; once is enough.
    seed : int
        Names the run: nothing is drawn.
    degree : int
        Highest total degree of the features; a model with more than `MAX_FEATURES` of them has a lower one.
    prior : float
        Ridge on the weights of a forward model, in units of the variance of what it cannot explain.
    inverse_prior : float
        The same of the inverse estimate; the hands leave open where the joints are, so that this is much larger.
    forgetting : float
        Weight of the past with every sample; 1 forgets nothing.
    residual_degree : int
        Highest total degree of the features of the residual, a function of the target that learns fast what the
        forward models of a learner that was taught have wrong by now; 0 is none.
    residual_prior, residual_forgetting : float
        Ridge and forgetting of the residual.
    damping : float
        mu of the Newton step, in parts of the mean diagonal of J J'.
    body : Body, optional
        The robot; without one, any joint may move any hand.

    Raises
    ------
    ConfigError
        If a value is of the wrong type or out of its range.
    """

    rule = "forward-inverse"
    remembers = False
    phases = ((LEARN, 1), (EVALUATE, 1))
    inputs: int = 6
    outputs: int = 21
    epochs: int = 1
    seed: int = 0
    degree: int = 3
    prior: float = 1e-5
    inverse_prior: float = 0.1
    forgetting: float = 1.0
    residual_degree: int = 0
    residual_prior: float = 0.1
    residual_forgetting: float = 0.999
    damping: float = 1e-6
    body: Body | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_whole("degree", self.degree, 1, MAX_DEGREE)
        _check_whole("residual_degree", self.residual_degree, 0, MAX_DEGREE)
        for name in ("prior", "inverse_prior", "residual_prior"):
            _check_number(name, getattr(self, name), 1e-12, 1e3)
        for name in ("forgetting", "residual_forgetting"):
            _check_number(name, getattr(self, name), 0.9, 1.0)
        _check_number("damping", self.damping, 1e-12, 1.0)
        known = self.known_body
        if (known.inputs, known.inputs + len(known.joints)) != (self.inputs, self.outputs):
            raise ConfigError(
                f"expected {known.inputs} inputs and {known.inputs + len(known.joints)} outputs of a body with "
                f"{len(known.hands)} hands and {len(known.joints)} joints, found {self.inputs} and {self.outputs}"
            )
        if too_large := [model for model in self.models if model.features > MAX_FEATURES]:
            name, found = too_large[0].name, too_large[0].features
            raise ConfigError(f"expected at most {MAX_FEATURES} features of model {name}, found {found} of degree 1")

    @property
    def known_body(self) -> Body:
        """The robot's body, or what is assumed without one."""
        return any_body(self.inputs, self.outputs) if self.body is None else self.body

    @property
    def models(self) -> tuple[ModelSize, ...]:
        """The inverse estimate, then the forward model of each hand, then the residual, if there is one."""
        body, inputs = self.known_body, tuple(range(self.inputs))
        inverse = _model("inverse", inputs, self.degree, len(body.joints))
        hands = zip(body.hands, body.moves, body.hand_axes, strict=True)
        residual = [_model(RESIDUAL, inputs, self.residual_degree, self.inputs)] if self.residual_degree else []
        forward = [_model(f"forward_{hand}", places, self.degree, len(axes)) for hand, places, axes in hands]
        return inverse, *forward, *residual

    @property
    def forward_models(self) -> tuple[ModelSize, ...]:
        """The forward model of each hand."""
        return self.models[1 : 1 + len(self.known_body.hands)]

    def state_shapes(self) -> dict[str, tuple[int, ...]]:
        """Names and shapes of the state, in the order in which it is digested.

        Of every model the weights; the covariance from its diagonal on, row after row; the squared errors of its
        outputs from before each update, weighted, with the sum of these weights at their end; and the sums of a line of
        squared errors over leverage, as `kernels.learn_errors` has them.
        """
        shapes: dict[str, tuple[int, ...]] = {}
        for model in self.models:
            shapes[f"{model.name}_weights"] = (model.features, model.outputs)
            shapes[f"{model.name}_covariance"] = (model.features * (model.features + 1) // 2,)
            shapes[f"{model.name}_errors"] = (model.outputs + 1,)
            shapes[f"{model.name}_leverage"] = (2 * model.outputs + 4,)
        return shapes

    def shown(self) -> Shown:
        """Show how far the weights of every model have moved."""
        return Shown(drift={model.name.replace("_", " "): f"{model.name}_weights" for model in self.models})

    def notes(self) -> tuple[str, ...]:
        """Return a line on every model that has a lower degree than was asked for."""
        wanted = {RESIDUAL: self.residual_degree}
        return tuple(
            f"{model.name.replace('_', ' ')}: degree {model.degree} in place of {degree}, which would take "
            f"{count_features(len(model.variables), degree)} features; {MAX_FEATURES} are the most"
            for model in self.models
            if model.degree < (degree := wanted.get(model.name, self.degree))
        )

    def element_name(self, array: str, index: tuple[int, ...]) -> str:
        """Name an element of the state by feature and output, such as `forward_right_weights[elbow*wrist, x]`."""
        body = self.known_body
        for model in self.models:
            known = {"inverse": body.joints, RESIDUAL: body.input_names}
            outputs = known.get(model.name, (AXES + TURNS)[: model.outputs])
            if array == f"{model.name}_errors":
                return f"{array}[{(*outputs, 'sum of weights')[index[0]]}]"
            if array == f"{model.name}_leverage":
                slopes = (f"{output}*leverage" for output in outputs)
                return f"{array}[{(*outputs, *slopes, *_SUMS)[index[0]]}]"
            features = self._feature_names(model)
            if array == f"{model.name}_weights":
                return f"{array}[{features[index[0]]}, {outputs[index[1]]}]"
            if array == f"{model.name}_covariance":
                row, column = _place_in_triangle(index[0], model.features)
                return f"{array}[{features[row]}, {features[column]}]"
        return super().element_name(array, index)

    def adaptive(self) -> Self:
        """Return the same with a residual."""
        return self if self.residual_degree else dataclasses.replace(self, residual_degree=RESIDUAL_DEGREE)

    def with_body(self, body: Body) -> Self:
        """Return the same with the body of a robot."""
        return dataclasses.replace(self, body=body, inputs=body.inputs, outputs=body.inputs + len(body.joints))

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain values, ready for JSON or TOML; without a body if there is none."""
        fields = {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}
        body = fields.pop("body")
        return fields if body is None else fields | {"body": body.to_dict()}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Make a configuration from plain values; absent keys take their default.

        Raises
        ------
        ConfigError
            If a key is unknown, or a value is of the wrong type or out of its range.
        """
        body = {"body": Body.from_dict(values["body"])} if values.get("body") is not None else {}
        return super().from_dict({**values, **body})

    def _feature_names(self, model: ModelSize) -> list[str]:
        body = self.known_body
        known = body.input_names if model.name in ("inverse", RESIDUAL) else body.joints
        names = [known[place] for place in model.variables]
        return [product_name(product, names) for product in make_features(len(names), model.degree).products]


def _model(name: str, variables: tuple[int, ...], wanted: int, outputs: int) -> ModelSize:
    degree = largest_degree(len(variables), wanted)
    return ModelSize(name, variables, degree, count_features(len(variables), degree), outputs)


def _place_in_triangle(index: int, size: int) -> tuple[int, int]:
    row = 0
    while index >= size - row:
        index -= size - row
        row += 1
    return row, row + index


def _check_whole(name: str, value: object, low: int, high: int) -> None:
    if type(value) is not int or not low <= value <= high:
        raise ConfigError(
            f"expected learner setting {name} to be a whole number from {low} to {high}, found {value_text(value)}"
        )


def _check_number(name: str, value: object, low: float, high: float) -> None:
    if type(value) not in (int, float) or not low <= value <= high:  # type: ignore[operator]  # a number
        raise ConfigError(
            f"expected learner setting {name} to be a number from {low:g} to {high:g}, found {value_text(value)}"
        )
