"""Files in and out, every mistake with its file and line.

In the order in which data walks through:

    document          YAML files with the line of every key
    units             a key's ending is its unit: between file and field, both ways, and the field's default
    schema            what a user may write in them
    joint_counting    `joints:`, how the controller counts
    devices           `measure:`, what makes measurements of each kind
    checks            what single values cannot show: units mixed up, names taken twice
    entries           between millimetres and degrees in files and what they describe, both ways
    template          the commented cell.yaml to start from
    description       cell, robot and jig from their YAML files, or from the library
    measurements      files that hold measurements of any kind
    tables            touches.csv, positions.csv and plan.csv
    kinds_plan        plan.csv of several kinds, and the table for what is read
    poses             poses.csv: tip poses that are wanted
    calibration_file  an identified robot, and calibration.json
    facets            rectangular faces of a part, from the triangles of its mesh
"""
