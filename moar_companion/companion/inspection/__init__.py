"""The inspection at a view: aim, steady flight, pictures, and the record of what was captured.

In: the view, the aircraft's motion, the camera's and the gimbal's progress. Out: what the camera
and the gimbal are asked for, and the view's outcome. Read first: `view_capture`.
"""
