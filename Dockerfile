# One image for every part of a convoy: router, vehicle, recorder. `docker-compose.yml` uses it.
FROM python:3.11-slim-bookworm

RUN python3 -m venv /opt/convoy
ENV PATH=/opt/convoy/bin:$PATH PYTHONUNBUFFERED=1

# Dependencies first: they change seldom, so this layer is built once.
COPY requirements.lock /tmp/requirements.lock
RUN pip install --no-cache-dir --require-hashes -r /tmp/requirements.lock

COPY pyproject.toml README.md LICENSE /tmp/convoy/
COPY vehicles /tmp/convoy/vehicles
COPY transport /tmp/convoy/transport
COPY scenarios /tmp/convoy/scenarios
RUN pip install --no-cache-dir --no-deps /tmp/convoy && rm -r /tmp/convoy

# Logs go to ./runs under this folder; mount a volume there to keep them.
WORKDIR /convoy
ENTRYPOINT ["convoy"]
CMD ["run"]
