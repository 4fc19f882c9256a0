# The operator page in a container:
#   docker build -t flatcloth .
#   docker run --rm -p 127.0.0.1:8080:8080 -e FLATCLOTH_TOKEN="$(openssl rand -hex 16)" \
#       -v "$PWD/my-recordings:/recordings:ro" -v flatcloth-sessions:/home/flatcloth flatcloth
# Any other command: docker run --rm -v "$PWD:/data" flatcloth run /data/my-recording --out /data/result
FROM debian:bookworm-slim
RUN apt-get update -qq \
    && apt-get install -qq --no-install-recommends python3 python3-venv ca-certificates \
    && rm -rf /var/lib/apt/lists/*
RUN python3 -m venv /opt/venv
ENV PATH=/opt/venv/bin:$PATH
COPY pyproject.toml constraints.txt README.md LICENSE /opt/flatcloth/
COPY flatcloth /opt/flatcloth/flatcloth
COPY static /opt/flatcloth/static
COPY recordings /opt/flatcloth/recordings
# Compiled while building, so that the first start does not wait for the compiler.
RUN pip install --quiet --no-cache-dir --constraint /opt/flatcloth/constraints.txt '/opt/flatcloth[export,ros]' \
    && python -m flatcloth.engine.warmup \
    && rm -rf /opt/flatcloth
RUN useradd --create-home flatcloth && mkdir /recordings
USER flatcloth
WORKDIR /home/flatcloth
EXPOSE 8080
ENTRYPOINT ["flatcloth"]
CMD ["view", "--host", "0.0.0.0", "--root", "/recordings"]
