# Flinders for a server: the live page, and fleets.
#
#   docker build -t flinders .
#   docker run -p 8410:8410 flinders                                     # the page, with a simulated sensor
#   docker run -p 8410:8410 --device /dev/ttyACM0 --group-add dialout flinders live --host 0.0.0.0 --serial /dev/ttyACM0
#   docker run --user "$(id -u)" -v "$PWD:/logs" flinders fleet . -o calibrations.parquet
FROM python:3.11-slim AS build
WORKDIR /flinders
COPY pyproject.toml hatch_build.py README.md LICENSE ./
COPY web web
COPY src src
# fetches Node.js and zig, which build the 3-D view and the engine
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /wheels .

FROM python:3.11-slim
RUN --mount=from=build,source=/wheels,target=/wheels \
    wheel=$(ls /wheels/*.whl) && pip install --no-cache-dir "flinders[all] @ file://$wheel"
RUN mkdir --mode 1777 /logs
USER nobody
WORKDIR /logs
EXPOSE 8410
ENTRYPOINT ["flinders"]
CMD ["live", "--host", "0.0.0.0"]
