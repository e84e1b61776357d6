"""Run a job through Kratos Multiphysics: mortar contact of ContactStructuralMechanicsApplication.

python3 bench/peers/kratos.py --sizes 22,18 --contact penalty --linear amgcl
"""

import argparse
import json
import pathlib
import sys

import KratosMultiphysics as KM
import KratosMultiphysics.ContactStructuralMechanicsApplication
import numpy as np
from KratosMultiphysics.StructuralMechanicsApplication.structural_mechanics_analysis import (
    StructuralMechanicsAnalysis,
)

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))

import jobs

NAMES = "lower", "upper"
LINEAR = {
    "amgcl": {
        "solver_type": "amgcl",
        "krylov_type": "cg",
        "smoother_type": "ilu0",
        "coarsening_type": "smoothed_aggregation",
        "tolerance": 1e-8,
        "max_iteration": 1000,
        "block_size": 3,
        "use_block_matrices_if_possible": True,
        "verbosity": 2,
        "scaling": False,
    },
    "sparse_lu": {"solver_type": "LinearSolversApplication.sparse_lu"},
}


def held(part, value):
    """Return a process that prescribes the displacement of nodes; None for free axes."""
    return {
        "python_module": "assign_vector_variable_process",
        "kratos_module": "KratosMultiphysics",
        "Parameters": {
            "model_part_name": f"Structure.{part}",
            "variable_name": "DISPLACEMENT",
            "constrained": [z is not None for z in value],
            "value": value,  # also for axes that are not constrained
            "interval": [0.0, "End"],
        },
    }


def penalty_of_kratos(p):
    """Return the penalty that makes Kratos' contact about as stiff as that of the other programs.

    Kratos weights its gaps by the area of the slave's nodes. The factor of 9 is empirical: with it
    the force equals that of the other programs on the smallest meshes.
    """
    h = p.job.cell_size(p.sizes[NAMES.index(p.slave)])
    return jobs.penalty(p.job, p.sizes, p.factor) * 9 / h**2


def settings(p, planes):
    """Return the project parameters; `planes` are the axes of the symmetry planes."""
    penalty = p.contact == "penalty"
    master = NAMES[p.slave == NAMES[0]]
    constraints = [held("held_lower", [0.0] * 3), held("held_upper", [0.0, 0.0, p.job.PRESS])]
    for axis in planes:
        constraints.append(held(f"plane_{axis}", [0.0 if i == axis else None for i in range(3)]))
    slave_first = [f"touching_{p.slave}", f"touching_{master}"]
    return {
        "problem_data": {
            "problem_name": "job",
            "parallel_type": "OpenMP",
            "start_time": 0.0,
            "end_time": 1.0,
            "echo_level": 0,
        },
        "solver_settings": {
            "solver_type": "Static",
            "model_part_name": "Structure",
            "domain_size": 3,
            "echo_level": 1,
            "analysis_type": "non_linear",
            "model_import_settings": {"input_type": "use_input_model_part"},
            "time_stepping": {"time_step": 1.1},
            "max_iteration": 30,
            "contact_settings": {
                "mortar_type": "PenaltyContactFrictionless"
                if penalty
                else "ALMContactFrictionless",
                "fancy_convergence_criterion": True,
                "silent_strategy": False,
                "contact_residual_relative_tolerance": p.rtol,
            },
            "convergence_criterion": "contact_residual_criterion",
            "residual_relative_tolerance": p.rtol,
            "linear_solver_settings": LINEAR[p.linear],
        },
        "processes": {
            "constraints_process_list": constraints,
            "contact_process_list": [
                {
                    "python_module": f"{'penalty' if penalty else 'alm'}_contact_process",
                    "kratos_module": "KratosMultiphysics.ContactStructuralMechanicsApplication",
                    "Parameters": {
                        "model_part_name": "Structure",
                        "contact_model_part": {"0": slave_first},
                        "assume_master_slave": {"0": slave_first[:1]},
                        "contact_type": "Frictionless",
                        "integration_order": 2,
                    }
                    | (
                        {
                            "advance_ALM_parameters": {
                                "manual_ALM": True,
                                "penalty": penalty_of_kratos(p),
                            }
                        }
                        if penalty and p.factor
                        else {}
                    ),
                }
            ],
        },
    }


def fill(model_part, job, bodies):
    """Add nodes, elements, contact conditions and properties of both cubes."""
    node, cell, face = 1, 1, 1
    for axis in bodies[0].planes:
        model_part.CreateSubModelPart(f"plane_{axis}")
    for i, (name, body) in enumerate(zip(NAMES, bodies, strict=True)):
        material = model_part.CreateNewProperties(i + 1)
        material.SetValue(KM.YOUNG_MODULUS, job.E[i])
        material.SetValue(KM.POISSON_RATIO, job.NU)
        material.SetValue(
            KM.CONSTITUTIVE_LAW, KM.KratosGlobals.GetConstitutiveLaw("LinearElastic3DLaw").Clone()
        )
        for k, x in enumerate(body.x.tolist(), node):
            model_part.CreateNewNode(k, *x)
        kind = "SmallDisplacementElement3D8N"
        for k, nodes in enumerate((body.cells + node).tolist(), cell):
            model_part.CreateNewElement(kind, k, nodes, material)
        for axis, quads in body.planes.items():
            part = model_part.GetSubModelPart(f"plane_{axis}")
            part.AddNodes((np.unique(quads) + node).tolist())
        held, touching = (body.high, body.low) if i else (body.low, body.high)
        part = model_part.CreateSubModelPart(f"held_{name}")
        part.AddNodes((np.unique(held) + node).tolist())
        part = model_part.CreateSubModelPart(f"touching_{name}")
        part.AddNodes((np.unique(touching) + node).tolist())
        for k, nodes in enumerate((touching + node).tolist(), face):
            part.CreateNewCondition("SurfaceCondition3D4N", k, nodes, material)
        node += len(body.x)
        cell += len(body.cells)
        face += len(touching)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    jobs.add_arguments(parser)
    parser.add_argument("--contact", choices=("penalty", "alm"), default="penalty")
    parser.add_argument("--linear", choices=tuple(LINEAR), default="amgcl")
    parser.add_argument("--factor", type=float, help="penalty over E/h; default: Kratos' own")
    parser.add_argument("--slave", choices=NAMES, default="upper")
    parser.add_argument("--rtol", type=float, default=1e-6, help="tolerance of Newton's method")
    p = jobs.parse(parser)
    bodies = p.job.bodies(p.sizes)
    KM.ParallelUtilities.SetNumThreads(1)
    model = KM.Model()
    parameters = KM.Parameters(json.dumps(settings(p, bodies[0].planes)))
    analysis = StructuralMechanicsAnalysis(model, parameters)
    model_part = model["Structure"]
    fill(model_part, p.job, bodies)
    analysis.Run()
    reaction = sum(
        node.GetSolutionStepValue(KM.REACTION_Z) for node in model["Structure.held_lower"].Nodes
    )
    newton = model_part.ProcessInfo[KM.NL_ITERATION_NUMBER]
    u = [list(node.GetSolutionStepValue(KM.DISPLACEMENT)) for node in model_part.Nodes]
    jobs.report(
        p.output,
        u,
        force=abs(reaction),
        newton=newton,
        version=KM.KratosGlobals.Kernel.Version().split("--")[0].replace('"', ""),
    )


if __name__ == "__main__":
    main()
