# Runs the patch test; any other command runs as well:
#
#   docker run --rm qsdolfinx
#   docker run --rm qsdolfinx pytest
#   docker run --rm qsdolfinx mpirun -n 2 python3 demos/hertz.py
FROM debian:trixie-slim

# Sections of debian-packages.txt. The compiler is there anyway: DOLFINx compiles forms when they
# are used. With "lint" as well, `make lint` and `make test` run inside.
ARG SECTIONS="runtime build test pictures"
COPY debian-packages.txt /tmp/
RUN export DEBIAN_FRONTEND=noninteractive \
    && apt-get update \
    && for section in $SECTIONS; do sed -n "/^# $section/,/^\$/p" /tmp/debian-packages.txt; done \
        | sed 's/#.*//' | xargs apt-get install -y --no-install-recommends \
    && apt-get clean \
    && rm -rf /var/lib/apt/lists/* /tmp/debian-packages.txt

RUN useradd --create-home qsdolfinx
WORKDIR /home/qsdolfinx/qsdolfinx
COPY --chown=qsdolfinx . .
RUN python3 -m pip install --break-system-packages --no-build-isolation --no-deps --no-index \
        --no-cache-dir --root-user-action=ignore . \
    && rm -rf build \
    && chown qsdolfinx: .

USER qsdolfinx
# PYTHONSAFEPATH: the installed qsdolfinx, not the folder of the same name. Ranks share memory in
# /tmp, since containers have 64 MB of /dev/shm.
ENV LC_ALL=C.UTF-8 \
    OMP_NUM_THREADS=1 \
    OMPI_MCA_btl=self,sm \
    OMPI_MCA_btl_sm_backing_directory=/tmp \
    OMPI_MCA_mpi_yield_when_idle=1 \
    PRTE_MCA_rmaps_default_mapping_policy=:oversubscribe \
    PYTHONSAFEPATH=1
CMD ["python3", "demos/patch_test.py", "--plot", "patch_test.png"]

# Where the sources are: --build-arg SOURCE=URL.
ARG SOURCE=unknown
LABEL org.opencontainers.image.title="qsdolfinx" \
      org.opencontainers.image.description="Quasi-symmetric contact between deformable bodies on non-matching meshes, for DOLFINx" \
      org.opencontainers.image.licenses="MIT" \
      org.opencontainers.image.version="0.1.0" \
      org.opencontainers.image.source="$SOURCE"
