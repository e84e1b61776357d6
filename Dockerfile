FROM debian:trixie-slim

COPY debian-packages.txt /tmp/
RUN export DEBIAN_FRONTEND=noninteractive \
    && apt-get update \
    && sed 's/#.*//' /tmp/debian-packages.txt | xargs apt-get install -y --no-install-recommends \
    && rm -rf /var/lib/apt/lists/* /tmp/debian-packages.txt

RUN useradd --create-home qsdolfinx
WORKDIR /home/qsdolfinx/qsdolfinx
COPY . .
RUN python3 -m pip install --break-system-packages --no-build-isolation --no-deps --no-index \
        --no-cache-dir --root-user-action=ignore . \
    && chown -R qsdolfinx: .

USER qsdolfinx
# PYTHONSAFEPATH: the installed qsdolfinx, not the folder of the same name.
ENV LC_ALL=C.UTF-8 \
    OMP_NUM_THREADS=1 \
    OMPI_MCA_btl=self,sm \
    OMPI_MCA_mpi_yield_when_idle=1 \
    PRTE_MCA_rmaps_default_mapping_policy=:oversubscribe \
    PYTHONSAFEPATH=1
CMD ["python3", "demos/patch_test.py", "--plot", "patch_test.png"]
