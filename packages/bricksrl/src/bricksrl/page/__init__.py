"""Live page: a robot in the browser while it learns, plays or is driven. Importing this loads
nothing else.

Any scene can be shown, with its own sliders:

    board = Board() board.show_drawing(drawing, poses(positions))  # bricktwin.view.drawing_of_body
    board.update_status(title="my plan", sliders=[{"name": "step", "low": 1, "high": 12, "value":
    12}]) with PageServer(board, on_press, on_stop) as server:  # on_press("slider", ["step", 3],
    visitor) print_line(server.url)
"""
