"""The service: the companion machine without I/O, and the asyncio shell that carries its bytes."""
