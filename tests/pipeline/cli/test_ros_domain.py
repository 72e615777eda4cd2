"""`--ros` and `--remap`: which keys of topics they choose, and what is refused in one line."""

import json
from contextvars import copy_context
from pathlib import Path

import pytest
from here import reenact_here
from processes import complaint
from typer.testing import CliRunner

from pipeline.cli.app import app, main
from pipeline.cli.robot.explore import DriveOptions
from pipeline.cli.ros_domain import topic_keys
from pipeline.cli.sessions import ListeningNode, LookingSession
from recorders.errors import ConfigError, ReenactError
from recorders.messages.topics import JOINT_STATES, LEFT_TARGET
from recorders.wire.keys.ros_keys import RosKeys
from recorders.wire.keys.topic_keys import NamespaceKeys
from recorders.wire.loopback import free_endpoint
from recorders.wire.session import DEFAULT_ENDPOINT


def test_without_a_domain_topics_are_below_the_namespace() -> None:
    assert topic_keys("serve", "lab", None, None) == NamespaceKeys("lab")


@pytest.mark.parametrize(
    ("name", "in_ros"),
    [
        ("controller", "/controller"),
        ("arm-2.left", "/arm_2_left"),
        ("2nd", "/_2nd"),
        ("a__b", "/a_b"),
        ("a._b", "/a_b"),
        ("__", "/_"),
    ],
)
def test_a_node_has_its_name_as_ros_takes_it(name: str, in_ros: str) -> None:
    keys = topic_keys(name, "lab", 3, [])
    assert isinstance(keys, RosKeys)
    assert (keys.domain, keys.namespace, keys.node.name.full_name) == (3, "lab", in_ros)


def test_rules_rename_topics_and_the_node() -> None:
    keys = topic_keys("serve", "lab", 3, ["__node:=arm", "__ns:=/left", "joint_states:=/state", f"{LEFT_TARGET}:=/no"])
    assert isinstance(keys, RosKeys)
    assert keys.node.name.full_name == "/left/arm"
    assert keys.graph_name(JOINT_STATES) == "/state"
    assert keys.graph_name(LEFT_TARGET) == f"/left{LEFT_TARGET}"


@pytest.mark.parametrize(
    "rule", ["", "a", "a=b", ":=b", "a:=", "a:=b c", "a b:=c", "a:=b:=c", "__ns:=lab", "__node:=a/b"]
)
def test_a_rule_that_is_none_is_refused(rule: str) -> None:
    with pytest.raises(ReenactError, match="expected"):
        topic_keys("serve", "lab", 3, [rule])


def test_rules_need_a_domain() -> None:
    with pytest.raises(ConfigError, match="--remap: expected --ros beside it, found 'a:=b' alone"):
        topic_keys("serve", "lab", None, ["a:=b"])
    with pytest.raises(ConfigError, match="--humble: expected --ros beside it"):
        topic_keys("serve", "lab", None, None, humble=True)


def test_topics_for_ros_2_humble_have_no_hashes() -> None:
    keys = topic_keys("serve", "lab", 3, None, humble=True)
    assert keys.key(JOINT_STATES) == f"3{JOINT_STATES}/sensor_msgs::msg::dds_::JointState_/TypeHashNotSupported"


@pytest.mark.parametrize("domain", ["233", "-1", "a", "", "1_0", "\u0663", "9" * 5000])
def test_what_is_no_domain_is_refused(domain: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["cat", "--connect", "tcp/127.0.0.1:9", f"--ros={domain}"])
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"expected 0 to 232, or none, found {domain[:40]!r}" in line


def test_the_verbs_refuse_in_one_line(tmp_path: Path) -> None:
    asked = reenact_here("cat", "--connect", "tcp/127.0.0.1:9", "--ros", "2", "--remap", "a=b", cwd=tmp_path)
    assert complaint(asked) == (
        "reenact: remap: expected FROM:=TO, such as joint_states:=/arm/joint_states, found 'a=b'"
    )
    printed = reenact_here("cat", "log.mcap", "--ros", "2", cwd=tmp_path)
    assert complaint(printed) == "reenact: --connect, --listen, --ros: expected no recording beside them"


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        ("cat log.mcap --remap a:=b", "--remap: expected no recording beside it"),
        ("cat --ros 2 --humble", "--humble: expected a verb that publishes, found cat"),
        ("record --ros 2 --humble", "--humble: expected a verb that publishes, found record"),
        ("status --ros 2 --namespace foo", "--namespace: expected none beside --ros"),
        ("status --ros 2 --namespace foo/**", "--namespace: expected none beside --ros"),
    ],
)
def test_an_option_of_no_use_is_refused(arguments: str, expected: str) -> None:
    assert str(CliRunner().invoke(app, arguments.split()).exception).startswith(expected)


def test_a_namespace_on_the_command_line_counts_for_more_than_a_domain_of_the_settings(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "reenact.toml").write_text("ros = 2\n")
    monkeypatch.chdir(tmp_path)
    arguments = ["status", "--connect", free_endpoint(), "--namespace", "lab", "--wait", "0", "--json"]
    looked = copy_context().run(CliRunner().invoke, app, arguments)  # settings are of a context
    assert (looked.exit_code, json.loads(looked.stdout)) == (1, {"nodes": []})


def test_in_a_domain_every_verb_connects_to_the_router_unless_it_is_to_listen() -> None:
    router = (DEFAULT_ENDPOINT,)
    assert ListeningNode().config().listen == ListeningNode(ros=3, listen=[DEFAULT_ENDPOINT]).config().listen == router
    assert ListeningNode(ros=3).config().connect == LookingSession(ros=3).config().connect == router
    assert LookingSession(ros=3).is_given
    assert DriveOptions(ros=3).wanted
