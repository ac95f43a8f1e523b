"""All targets by name."""

from __future__ import annotations

from tests.fuzz.decks import DECKS
from tests.fuzz.documents import DOCUMENTS
from tests.fuzz.scenes import SCENE
from tests.fuzz.simulator_files import SIMULATOR_FILES
from tests.fuzz.stored_files import STORED_FILES
from tests.fuzz.tables import TABLES

TARGETS = {
    target.name: target
    for target in (SCENE, *TABLES, *SIMULATOR_FILES, *STORED_FILES, *DOCUMENTS, *DECKS)
}
