"""Texts that pilots and operators read, and how numbers and names appear in them. Pure.

In: values. Out: texts of one STATUSTEXT each. Read first: `pilot_texts`, `text_patterns`,
`text_format`. Texts of conditions: `companion.safety.conditions`.
"""
