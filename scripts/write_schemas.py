"""Write the schemas of all documents into docs/schemas.

A file that is no schema any more goes.
"""

from pathlib import Path

from taction.verification.report.documents.catalogue import schemas

FOLDER = Path(__file__).resolve().parent.parent / "docs" / "schemas"


def main() -> None:
    """Write every schema that is not up to date."""
    FOLDER.mkdir(exist_ok=True)
    texts = dict(schemas())
    for name, schema in texts.items():
        (FOLDER / name).write_text(schema, encoding="utf-8")
    for path in FOLDER.glob("*.json"):
        if path.name not in texts:
            path.unlink()


if __name__ == "__main__":
    main()
