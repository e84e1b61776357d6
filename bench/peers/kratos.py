"""The job through Kratos Multiphysics: mortar contact of its ContactStructuralMechanicsApplication.

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

import cubes

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


def held(name, z):
    """Process that holds a face at u_z = z."""
    return {
        "python_module": "assign_vector_variable_process",
        "kratos_module": "KratosMultiphysics",
        "Parameters": {
            "model_part_name": f"Structure.held_{name}",
            "variable_name": "DISPLACEMENT",
            "constrained": [True] * 3,
            "value": [0.0, 0.0, z],
            "interval": [0.0, "End"],
        },
    }


def penalty_of_kratos(sizes, p):
    """Penalty that makes Kratos' contact about as stiff as that of the others.

    Its gaps are weighted by the area of the slave's nodes. The factor of 9 is measured: it is what
    gives the force of the others on the smallest meshes.
    """
    n = sizes[NAMES.index(p.slave)]
    return cubes.penalty(sizes, p.factor) * 9 * n**2


def settings(p, sizes):
    """Project parameters."""
    penalty = p.contact == "penalty"
    master = NAMES[p.slave == NAMES[0]]
    slave_first = [f"touching_{p.slave}", f"touching_{master}"]
    return {
        "problem_data": {
            "problem_name": "cubes",
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
            "constraints_process_list": [held("lower", 0.0), held("upper", cubes.PRESS)],
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
                                "penalty": penalty_of_kratos(sizes, p),
                            }
                        }
                        if penalty and p.factor
                        else {}
                    ),
                }
            ],
        },
    }


def fill(model_part, sizes):
    """Nodes, elements, contact conditions and properties of both cubes."""
    node, cell, face = 1, 1, 1
    for i, (name, n) in enumerate(zip(NAMES, sizes, strict=True)):
        body = cubes.cube(n, float(i))
        material = model_part.CreateNewProperties(i + 1)
        material.SetValue(KM.YOUNG_MODULUS, cubes.E[i])
        material.SetValue(KM.POISSON_RATIO, cubes.NU)
        material.SetValue(
            KM.CONSTITUTIVE_LAW, KM.KratosGlobals.GetConstitutiveLaw("LinearElastic3DLaw").Clone()
        )
        for k, x in enumerate(body.x.tolist(), node):
            model_part.CreateNewNode(k, *x)
        kind = "SmallDisplacementElement3D8N"
        for k, nodes in enumerate((body.cells + node).tolist(), cell):
            model_part.CreateNewElement(kind, k, nodes, material)
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
    parser.add_argument("--sizes", required=True)
    parser.add_argument("--contact", choices=("penalty", "alm"), default="penalty")
    parser.add_argument("--linear", choices=tuple(LINEAR), default="amgcl")
    parser.add_argument("--factor", type=float, help="penalty over E/h; otherwise Kratos' own")
    parser.add_argument("--slave", choices=NAMES, default="upper")
    parser.add_argument("--rtol", type=float, default=1e-6, help="where Newton's method ends")
    p = parser.parse_args()
    sizes = [int(n) for n in p.sizes.split(",")]
    KM.ParallelUtilities.SetNumThreads(1)
    model = KM.Model()
    analysis = StructuralMechanicsAnalysis(model, KM.Parameters(json.dumps(settings(p, sizes))))
    model_part = model["Structure"]
    fill(model_part, sizes)
    analysis.Run()
    reaction = sum(
        node.GetSolutionStepValue(KM.REACTION_Z) for node in model["Structure.held_lower"].Nodes
    )
    newton = model_part.ProcessInfo[KM.NL_ITERATION_NUMBER]
    cubes.report(
        force=abs(reaction),
        newton=newton,
        version=KM.KratosGlobals.Kernel.Version().split("--")[0].replace('"', ""),
    )


if __name__ == "__main__":
    main()
