# The demo on the built-in synthetic street, without learned parts:
#   docker build --tag geovp . && mkdir -p results
#   docker run --rm --user "$(id -u)" --volume "$PWD/results:/work/results" geovp
FROM python:3.11-slim AS build
WORKDIR /source
COPY pyproject.toml MANIFEST.in README.md LICENSE constraints.txt ./
COPY geovp geovp
COPY geovp_classic geovp_classic
COPY learned learned
COPY benchmarks benchmarks
RUN python -m venv /venv \
    && /venv/bin/pip install --no-cache-dir --constraint constraints.txt .

FROM python:3.11-slim
COPY --from=build /venv /venv
ENV PATH=/venv/bin:$PATH NUMBA_CACHE_DIR=/tmp/numba MPLCONFIGDIR=/tmp/matplotlib
RUN useradd --create-home user && install --directory --owner user /work
USER user
WORKDIR /work
ENTRYPOINT ["geovp"]
CMD ["run", "demo", "--set", "metrics.frame=[\"psnr\", \"ssim\"]"]
