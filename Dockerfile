# docker build -t co-speech-motion . && docker run --rm -p 7860:7860 co-speech-motion
#
# The steps are the scripts that `make demo` runs, so that trying those tries this.
FROM python:3.11-slim

WORKDIR /srv/co-speech-motion
COPY .ci .ci
RUN .ci/system-packages run && rm -rf /var/lib/apt/lists/*
COPY requirements.txt requirements-cluster.txt ./
COPY locks locks
ENV PIP_NO_CACHE_DIR=1
RUN .ci/venv run
COPY app.py ./
COPY app app
COPY conventions conventions
COPY model model
COPY processes processes
COPY renderer renderer
COPY tools tools
COPY examples examples

RUN useradd --create-home visitor
USER visitor
RUN .venv/bin/python -m model.speech.librosa_cache
EXPOSE 7860
HEALTHCHECK --start-period=60s --interval=30s --timeout=5s \
    CMD [".venv/bin/python", "-c", "import urllib.request as web; web.urlopen('http://127.0.0.1:7860/config', timeout=4)"]
CMD [".venv/bin/python", "app.py", "--host", "0.0.0.0"]
