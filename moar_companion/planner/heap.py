"""The compiled binary heap of the search: items by their keys, the least first.

Three arrays: keys and items of the heap, in its order; the place of each item in it, -1 for absent
items.
"""

from __future__ import annotations

from .arrays import HEAP
from .grid import FloatArray, IntArray
from .jit import F8, I8, jit


@jit(I8, *HEAP, I8, F8, I8, helper=True)
def put(
    keys: FloatArray, items: IntArray, position: IntArray, size: int, key: float, item: int
) -> int:
    """Puts an item into the heap, or lowers its key there; the heap's size then."""
    at = position[item]
    if at < 0:
        at = size
        size += 1
    while at > 0:
        parent = (at - 1) >> 1
        if keys[parent] <= key:
            break
        keys[at] = keys[parent]
        items[at] = items[parent]
        position[items[at]] = at
        at = parent
    keys[at] = key
    items[at] = item
    position[item] = at
    return size


@jit(I8, *HEAP, I8, helper=True)
def take(keys: FloatArray, items: IntArray, position: IntArray, size: int) -> int:
    """Takes the least item, at index 0, out of the heap; the heap's size then."""
    position[items[0]] = -1
    size -= 1
    if size == 0:
        return size
    key, item = keys[size], items[size]
    at = 0
    while True:
        child = 2 * at + 1
        if child >= size:
            break
        if child + 1 < size and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        keys[at] = keys[child]
        items[at] = items[child]
        position[items[at]] = at
        at = child
    keys[at] = key
    items[at] = item
    position[item] = at
    return size
