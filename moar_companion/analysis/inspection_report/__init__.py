"""Report of an inspection flight: one page with what was captured, and where. Pure.

In: messages of a flight's recording, rows of its inspection record, pictures by name and time. Out:
a self-contained HTML page. Read first: `flight_account`, `report_page`.
"""
