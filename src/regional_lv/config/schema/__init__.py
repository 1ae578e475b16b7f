"""The schema of the configuration, the one place of keys, units, defaults and limits."""

from functools import cache
from pathlib import Path

import yaml

SCHEMA_FILE = Path(__file__).parent / "config.schema.yaml"


@cache
def load_schema() -> dict:
    """The schema with its references (`$ref`) resolved; keys beside a reference take precedence."""
    schema = yaml.safe_load(SCHEMA_FILE.read_text())
    definitions = schema.pop("$defs")

    def resolve(node):
        if isinstance(node, dict):
            if "$ref" in node:
                own = {key: value for key, value in node.items() if key != "$ref"}
                return resolve(definitions[node["$ref"].rsplit("/", 1)[1]] | own)
            return {key: resolve(value) for key, value in node.items()}
        return [resolve(item) for item in node] if isinstance(node, list) else node

    return resolve(schema)
