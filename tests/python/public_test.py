"""Every public function and method, called with nothing, with another type, with NaN, with a name too many: what it
raises is a tiller.Error with a remedy."""
import inspect

import numpy as np
import pytest

import tiller

NAN = float("nan")
STATE, INPUTS = [0.0, 0.0], [[0.0]] * 3


@pytest.fixture(scope="module")
def robot():
    return tiller.Robot.from_toml("pendulum")


@pytest.fixture(scope="module")
def this(robot):
    """An object of each class that has methods."""
    controller = tiller.Controller(robot)
    controller.tick(0.0, [0.0])
    result = tiller.IdentifyResult({"candidates": []}, None, "", 0, None)
    return {"Robot": robot, "Controller": controller, "Plant": tiller.Plant(robot), "Posterior": controller.posterior,
            "IdentifyResult": result}


# What each is called with wrongly; a robot stands for "robot". Calls without arguments and with a name that none has
# are made of all of them.
WRONG = {
    "Robot": [("x",)],
    "Robot.from_toml": [(3,), ("nowhere",), ("nowhere.toml",), (None,)],
    "Robot.from_text": [(3,), ("[model]",), ("[model]\nname = 'pendulum'", 3)],
    "Robot.from_urdf": [(3,), ("nowhere.urdf",), ("nowhere.urdf", 3)],
    "Robot.from_model_header": [(3, "A", {}), ("nowhere.hpp", "A", {}), (__file__, 3, {}), (__file__, "A", 3),
                                (__file__, "A", "nowhere.toml"), (__file__, "A", __file__)],
    "Robot.stage_cost": [("x", [0.0]), ([0.0], [0.0]), (STATE, [NAN]), ([NAN, 0.0], [0.0]), (STATE, [0.0], -1),
                         (STATE, [0.0], NAN), (STATE, [0.0], 10**30)],
    "Controller": [("pendulum",), ("robot", 0), ("robot", "two"), ("robot", NAN), ("robot", 1, "no"),
                   ("robot", None), ("robot", 1, True, -4), ("robot", 1, True, "x"), ("robot", 1, True, 4, 5)],
    "Controller.tick": [("now",), (NAN,), (None, [0.0]), (1.0, "x"), (1.0, [0.0, 1.0]), (1.0, [0.0], 3)],
    "Controller.set_target": [("up",), ([0.0],), ([NAN, 0.0],), (None,)],
    "Controller.set_output_target": [("up",), ([0.0, 1.0],)],
    "Controller.set_reference": [("path",), ([0.0],), (np.zeros((3, 5)),), (np.full((3, 2), NAN),), (None, "path")],
    "Controller.force_iterations": [("two",), (-1,), (NAN,), (1.5,)],
    "Controller.prepare": [(1,)], "Controller.arm": [(1,)], "Controller.disarm": [(1,)], "Controller.stop": [(1,)],
    "Controller.reset": [(1,)], "Controller.prediction": [(1,), ()], "Controller.outputs": [(1,)],
    "Controller.frame_forces": [(1,)],
    "Posterior": [(1,)], "Posterior.quantiles": [("x",), ([NAN],), ([2.0],), (0.5,)], "Posterior.covariance": [(1,)],
    "Info": [(1,)], "Command": [(1,)],
    "Measurement": [("robot",), (3, 0.0, [0.0]), ("robot", NAN, [0.0]), ("robot", 0.0, "x"), ("robot", 0.0, [0.0], -1),
                    ("robot", 0.0, [0.0], 0, NAN), ("robot", 0.0, [0.0], 0, -1.0), ("robot", 0.0, [0.0], 0, 0.0, 1)],
    "Plant": [("pendulum",), ("robot", -1), ("robot", NAN), ("robot", "one"), ("robot", 1, 2)],
    "Plant.step": [("x",), ([NAN],), ([0.0, 1.0],), (None,)],
    "rollout": [("pendulum", STATE, INPUTS), ("robot",), ("robot", "x", INPUTS), ("robot", STATE, [0.0]),
                ("robot", [NAN, 0.0], INPUTS), ("robot", STATE, [[NAN]]), ("robot", STATE, INPUTS, [NAN] * 3),
                ("robot", STATE, INPUTS, None, 3)],
    "lockstep": [("pendulum", 1.0), (None, NAN), ("plant", NAN), ("plant", "long"), ("plant", -1.0), ("plant", None)],
    "identify": [(3, "log.csv"), ("robot", 3), ("robot", "nowhere.csv"), ("robot", []), ("robot", __file__, 3)],
    "gap": [(3, "log.csv"), ("robot", 3), ("robot", "nowhere.csv"), ("robot", [])],
    "excite": [(3,), ("nowhere",), ("robot", "out.csv")],
    "learn": [(3, "log.csv"), ("robot", 3), ("robot", "nowhere.csv"), ("robot", [])],
    "IdentifyResult": [(1,)], "GapResult": [(1,)], "ExciteResult": [(1,)], "LearnResult": [(1,)], "Result": [(1,)],
    "IdentifyResult.parameters": [("last",), (7,), (0,)],
    "instruction_set": [(1,)], "model_names": [(1,)], "robot_names": [(1,)], "version": [(1,)],
}
OPTIONS = [("rollout", ("robot", STATE, INPUTS), {"dtype": "words"}), ("rollout", ("robot", STATE, INPUTS), {"dtype": int}),
           ("rollout", ("robot", STATE, INPUTS), {"threads": "all"}), ("rollout", ("robot", STATE, INPUTS), {"out": [0.0]}),
           ("rollout", ("robot", STATE, INPUTS), {"threads": NAN}), ("rollout", ("robot", STATE, INPUTS), {"history": [[NAN]]}),
           ("excite", ("robot",), {"seconds": NAN}), ("excite", ("robot",), {"seconds": object()}),
           ("excite", ("robot",), {"out": 3}), ("identify", ("robot", __file__), {"hold_out": 3}),
           ("identify", ("robot", __file__), {"out": 3}), ("gap", ("robot", __file__), {"budget": "much"}),
           ("learn", ("robot", __file__), {"out": 3})]
# what may be called with nothing
OPTIONAL = {"instruction_set", "model_names", "robot_names", "version", "IdentifyResult.parameters"}


def public():
    """Names of all that can be called, methods as "Class.method"."""
    for name in tiller.__all__:
        value = getattr(tiller, name)
        if isinstance(value, type) and issubclass(value, (Exception, int)):
            continue  # exceptions and enumerations
        yield name
        for method, member in vars(value).items() if isinstance(value, type) else ():
            takes = list(inspect.signature(member).parameters) if inspect.isfunction(member) else ["?"]
            if not method.startswith("_") and (isinstance(member, staticmethod) or inspect.isroutine(member)) and \
                    takes != ["self"]:
                yield f"{name}.{method}"


def find(name, this):
    kind, _, method = name.partition(".")
    if not method:
        return getattr(tiller, kind)
    return getattr(this.get(kind, getattr(tiller, kind)), method)


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))


def expect_error(call, args, options, robot, this):
    given = [{"robot": robot, "plant": this["Plant"]}.get(a, a) if isinstance(a, str) else a for a in args]
    with pytest.raises(tiller.Error) as caught:
        call(*given, **options)
    error = caught.value
    assert error.remedy, error
    assert isinstance(error, tiller.CommandError) or error.remedy in str(error), error  # a command's is in its output
    assert "argument types are supported" not in str(error), error  # the binding's list of them
    return error


def test_every_public_call_is_in_the_table():
    assert set(public()) == set(WRONG)


@pytest.mark.parametrize("name", sorted(WRONG))
def test_wrong_calls_are_errors_with_a_remedy(name, robot, this):
    call = find(name, this)
    for args in WRONG[name]:
        expect_error(call, args, {}, robot, this)
    if name not in {"excite", "gap", "identify", "learn"}:  # which pass names on, as options of the command
        error = expect_error(call, (), {"nonsense": 1}, robot, this)
        assert isinstance(error, TypeError)
    simple = {"prepare", "arm", "disarm", "stop", "reset", "prediction", "outputs", "frame_forces", "covariance",
              "set_reference"}
    if name not in OPTIONAL and name.split(".")[-1] not in simple:
        assert isinstance(expect_error(call, (), {}, robot, this), (TypeError, ValueError))


@pytest.mark.parametrize("name, args, options", OPTIONS)
def test_wrong_options_are_errors_with_a_remedy(name, args, options, robot, this):
    expect_error(find(name, this), args, options, robot, this)


def test_messages_name_what_is_meant(robot):
    with pytest.raises(tiller.ArgumentTypeError, match=r"rollout: robot is 'pendulum'; expected a tiller.Robot; pass "
                                                       r"tiller.Robot.from_toml"):
        tiller.rollout("pendulum", STATE, INPUTS)
    with pytest.raises(tiller.ArgumentTypeError, match=r"Controller: robot is None; expected a tiller.Robot"):
        tiller.Controller()
    with pytest.raises(tiller.ArgumentTypeError, match=r"call Controller.set_target\(target"):
        tiller.Controller(robot).set_target()
    with pytest.raises(tiller.ArgumentTypeError, match=r"Controller: thread is 2; expected no argument of that name"):
        tiller.Controller(robot, thread=2)
    for given, shape in ((np.zeros((4, 3)), r"x0 is an array of shape \(4, 3\); expected shape \(n\) or \(B, n\), n = 2"),
                         (np.zeros(3), r"x0 .*\(n\) or \(B, n\)")):
        with pytest.raises(tiller.ArgumentError, match=shape):
            tiller.rollout(robot, given, INPUTS)
    with pytest.raises(tiller.ArgumentError, match=r"U .*\(H, n\) or \(B, H, n\), n = 1 \(torque_Nm\)"):
        tiller.rollout(robot, STATE, np.zeros((3, 2)))


@pytest.mark.parametrize("shape, argument, index", [((40, 2), "x0", (33, 1)), ((2,), "x0", (1,)), ((7, 1), "U", (5, 0)),
                                                    ((70, 7, 1), "U", (64, 3, 0)), ((70, 3), "params", (69, 2)),
                                                    ((3,), "params", (2,))])
def test_a_number_that_is_not_finite_is_told_by_its_place_in_the_array(robot, shape, argument, index):
    wrong = np.zeros(shape) if argument != "params" else np.full(shape, 0.5)
    wrong[index] = np.nan
    if len(index) > 1 and index[0] + 1 < shape[0]:
        wrong[index[0] + 1] = np.inf  # the first one is told
    arguments = {"x0": STATE, "U": INPUTS, "params": None, argument: wrong}
    with pytest.raises(tiller.ArgumentError) as caught:
        tiller.rollout(robot, **arguments, threads=2)
    assert f"{argument}[{', '.join(map(str, index))}]" in str(caught.value)
