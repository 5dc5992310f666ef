# rotorid on a slim Python: docker build -t rotorid . && docker run --rm -v "$PWD:/logs" rotorid review flight.ulg
# The image of this hash: a tag may move.
FROM python:3.12-slim@sha256:78387bc3881b8273120a12ebe6c1ab22b018ccc2c9adf565ae1ac9b536e184ea

COPY . /src
RUN pip install --no-cache-dir '/src[figures,parquet,hdf5,ros,lab]' && rm -rf /src

# Compiled code and results belong to a user without rights.
RUN useradd --create-home pilot && mkdir /logs && chown pilot /logs
USER pilot
ENV NUMBA_CACHE_DIR=/home/pilot/.cache/numba
RUN rotorid doctor

WORKDIR /logs
ENTRYPOINT ["rotorid"]
CMD ["--help"]
