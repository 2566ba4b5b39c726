# Two images: `vehicle`, for vehicles and routers, and the complete one, for recorders and all other
# commands. `docker-compose.yml` uses both.
FROM python:3.11-slim-bookworm AS base
RUN python3 -m venv /opt/convoy
ENV PATH=/opt/convoy/bin:$PATH PYTHONUNBUFFERED=1
# Dependencies first: they change rarely, so this layer is built once.
COPY requirements-container.lock /tmp/
RUN pip install --no-cache-dir --require-hashes -r /tmp/requirements-container.lock
# Logs go to ./runs under this folder; mount a volume there to keep them. Logs belong to the owner of
# that volume, not to root. A volume created by Docker belongs to root: its owner becomes that of the
# file `owner`, if that is mounted.
WORKDIR /convoy
RUN mkdir runs && touch owner && printf '%s\n' '#!/bin/sh -e' \
    'if [ "$(id -u):$(stat -c %u runs)" = 0:0 ]; then chown "$(stat -c %u:%g owner)" runs || :; fi' \
    'if [ "$(id -u)" != 0 ] || [ "$(stat -c %u runs)" = 0 ]; then exec convoy "$@"; fi' \
    'export HOME=/tmp' \
    'exec setpriv --reuid "$(stat -c %u runs)" --regid "$(stat -c %g runs)" --clear-groups convoy "$@"' \
    > /usr/local/bin/convoy-as-owner && chmod +x /usr/local/bin/convoy-as-owner
ENTRYPOINT ["convoy-as-owner"]
CMD ["run"]

# The project, compiled once for both images. Storing a layer may take seconds, so few layers depend
# on the project's files.
FROM base AS project
COPY . /tmp/convoy
RUN pip install --no-cache-dir --no-deps --prefix /tmp/installed /tmp/convoy

FROM base AS vehicle
COPY --from=project /tmp/installed /opt/convoy

FROM base AS whole
COPY requirements.lock /tmp/
RUN pip install --no-cache-dir --require-hashes -r /tmp/requirements.lock
COPY --from=project /tmp/installed /opt/convoy
