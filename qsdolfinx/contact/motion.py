"""How the unknowns of a contact's bodies move its surfaces, from where a step began."""

from __future__ import annotations

from petsc4py import PETSc

from dolfinx import fem

from qsdolfinx.base.checks import check_positive, check_type
from qsdolfinx.base.collective import check_agreement, collective_errors
from qsdolfinx.contact.terms import ContactAssembly
from qsdolfinx.gap.kinematics import Kinematics
from qsdolfinx.gap.weighted_gap import handle_of
from qsdolfinx.surface.affine import Affine
from qsdolfinx.surface.surface import Surface
from qsdolfinx.tools.rigid_surface import RigidSurface


class ContactMotion(ContactAssembly):
    """Scales, offsets and starts of the displacements that a contact sees."""

    _kinematics: Kinematics
    _offset: tuple[PETSc.Vec | None, PETSc.Vec | None] | None

    @property
    def unknown(self) -> tuple[str, str]:
        """``"displacement"`` or ``"velocity"``, of the slave's and of the master's body."""
        return self._kinematics.unknown

    @property
    def dt(self) -> float | None:
        """Δt, time; None if nothing depends on it."""
        return self._kinematics.dt

    @property
    def scale(self) -> tuple[float, float]:
        """Displacement per unknown of the slave's and the master's body: 1 or Δt."""
        return self._kinematics.scale

    @property
    def offset(self) -> tuple[PETSc.Vec | None, PETSc.Vec | None]:
        """Displacements (length) beside those of the unknowns, see :meth:`set_offset`."""
        return self._offset or (None, None)

    def set_dt(self, dt: float) -> None:
        """Set Δt (time) for the solves to come. Collective.

        Raises:
            ValueError: If it is not a positive number, the same on all ranks, or nothing
                depends on it.
        """
        with collective_errors(self.comm):
            if self._kinematics.dt is not None:
                check_positive("dt", dt)
            else:
                Kinematics(self.unknown, dt)
        check_agreement(self.comm, dt=dt)
        self._kinematics.dt = dt
        self.set_motion()

    def set_offset(self, slave: fem.Function | None, master: fem.Function | None) -> None:
        """Set displacements (length) beside those of the unknowns: u = scale · x + offset.

        For time stepping: from the meshes as they are, contact then sees the displacements to the
        end of the step, whatever part of the step the meshes have been moved already. Collective.

        Args:
            slave: On the space of the slave's body (the mixed one, if its surface has a sub-space),
                read now; None for no offset.
            master: The same for the master.

        Raises:
            ValueError: If a space is not that of the body.
        """
        for vec in self._offset or ():
            if vec is not None:
                vec.destroy()
        self._offset = (
            self._known("slave", self.slave, slave),
            self._known("master", self.master, master),
        )
        self.set_motion()

    def _known(
        self, name: str, surface: Surface | RigidSurface, function: fem.Function | None
    ) -> PETSc.Vec | None:
        """Owned values of a function on a body's space as a vector; None of a rigid tool."""
        vec = surface.create_vec() if isinstance(surface, Surface) else None
        with collective_errors(self.comm):
            if function is not None:
                check_type(name, function, fem.Function, "a dolfinx.fem.Function, or None")
                dofmap = function.function_space.dofmap
                owned = dofmap.index_map.size_local * dofmap.index_map_bs
                if vec is None or len(vec.array_r) != owned:
                    raise ValueError(f"{name}: the function must be on the space of the body")
                vec.array[:] = function.x.array[:owned]
        return vec

    def set_motion(self) -> None:
        """Hand scales and offsets to the passes. Collective."""
        for p in self.passes:
            slave, master = self.ordered(p, self.scale)
            p.scale = slave, master
            if self._offset is not None:
                u = self.ordered(p, self._offset)
                p.offset = p.operator.apply(handle_of(u[0]), handle_of(u[1]))

    def set_start(
        self,
        slave: fem.Function | None,
        master: fem.Function | None,
        moved: Affine | None = None,
    ) -> None:
        """Say where the step began whose slip is to be found; for time stepping. Collective.

        Without this, after pairing anew, it begins where the bodies are at the next evaluation.

        Args:
            slave: Unknowns of the slave's body at the start, as for :meth:`set_offset`.
            master: The same for the master.
            moved: Motion that a rigid tool has made in this step already, as a field over the
                places where it is now.
        """
        if self.tangential is None:
            return
        known = (
            self._known("slave", self.slave, slave),
            self._known("master", self.master, master),
        )
        for slip in self.slips:
            of_slave, of_master = self.ordered(slip.gap, known)
            slip.start, slip.starts_there = slip.jump_of((of_slave, of_master)), False
            if moved is not None:
                slip.start -= slip.change(moved)
        for vec in known:
            if vec is not None:
                vec.destroy()
