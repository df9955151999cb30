"""The table of texts to pilots: complete, consistent with the code, and each text valid."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

import moar_companion
from moar_companion.companion.safety.condition_types import Action, Look, Override, filled
from moar_companion.companion.safety.conditions import CONDITIONS, causes
from moar_companion.settings.config import Supervision
from moar_companion.texts.text_format import without_details
from tests.condition_actions import all_actions

from .seen import NOW_S
from .test_checks import STORIES
from .test_checks_of_place import STORIES as OF_PLACE

ROWS = pytest.mark.parametrize("row", CONDITIONS, ids=lambda row: row.name)
PLACEHOLDER = "words"
"""Reason of a fault in the stories of the checks."""


def form(text):
    """Pattern of all texts of one form: the parts in braces vary."""
    parts = re.split(r"\{[^}]*\}", text)
    return re.compile(".+?".join(map(re.escape, parts)))


def terms(text):
    return set(re.findall(r"[A-Za-z0-9/']+", text))


def reasons_of(name):
    """Reasons of a condition in the stories of the checks, without details."""
    found = (causes(Look(row[1], Supervision(), 1.5, NOW_S)) for row in STORIES + OF_PLACE)
    reasons = {each.get(name) for each in found} - {None, PLACEHOLDER}
    return {without_details(reason) for reason in reasons}


@pytest.fixture(scope="module")
def code_terms():
    """All terms in strings of the product, without docstrings and the table of conditions."""
    files = Path(moar_companion.__file__).parent.rglob("*.py")
    trees = [ast.parse(path.read_text()) for path in files if path.name != "conditions.py"]
    nodes = [node for tree in trees for node in ast.walk(tree)]
    docstrings = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    return {
        word
        for node in nodes
        if isinstance(node, ast.Constant) and isinstance(node.value, str)
        if id(node) not in docstrings
        for word in terms(node.value)
    }


def test_every_condition_has_its_texts():
    assert all(row.texts for row in CONDITIONS)


@ROWS
def test_a_text_fits_into_one_chunk_whole_with_its_action(row):
    for text, sent in zip(row.texts, row.examples, strict=True):
        assert len(sent) <= 50
        action = row.action_words(text)
        whole = filled(text) + (f", {action}" if action else "")
        assert sent == f"MOAR: {whole}"
        assert not re.search(r"(?<!\d)0\.0+(?!\d)", sent)
        assert {action} - {""} <= all_actions(row)


@ROWS
def test_a_text_of_a_condition_that_acts_has_an_action(row):
    unchanged = row.action is Action.CONTINUE and row.override is not Override.NONE
    assert all(bool(row.action_words(text)) is not unchanged for text in row.texts)


@ROWS
def test_each_sent_reason_has_the_form_of_a_text_in_the_table(row):
    forms = [form(text) for text in row.texts]
    for reason in reasons_of(row.name):
        assert any(each.fullmatch(reason) for each in forms), reason


@ROWS
def test_a_text_without_a_story_has_only_terms_of_the_code(row, code_terms):
    reasons = reasons_of(row.name)
    for text in row.texts:
        if not any(form(text).fullmatch(reason) for reason in reasons):
            assert terms(re.sub(r"\{[^}]*\}", " ", text)) <= code_terms, text
