"""Tables as a person writes them, and what reading says of mistakes in them."""

import pytest

from identify.model.files import InputError
from identify.model.io.tables import read_touches

TOUCHES = """\
id,time,status,face,nx,ny,nz,offset_mm,sigma_mm,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,temperature_c,note
t1,2024-05-01T08:00:00,hit,top-low,,,,,,10,-20,30.5,40,50,60,21.5,first
t2,2024-05-01T08:00:07,miss,top-low,,,,,,,,,,,,,
t3,2024-05-01T08:00:14,hit,,0,0.6,-0.8,120.5,0.1,11,-21,31,41,51,61,,
t4,2024-05-01T08:00:21,hit,right-low,,,,,0.03,12,-22,32,42,52,62,,"a note, with a comma"
"""
POSITIONS = """\
id,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,x_mm,y_mm,z_mm
p1,10,20,30,40,50,60,100,200,300
p2,11,21,31,41,51,61,150,200,300
p3,12,22,32,42,52,62,100,280,300
"""


def mistakes(path, cell, read=read_touches):
    """Mistakes as "line: sentence"."""
    with pytest.raises(InputError) as caught:
        read(path, cell)
    assert {m.file for m in caught.value.mistakes} == {str(path)}
    return [f"{m.line}: {m.text}" for m in caught.value.mistakes]


def change(text, old, new):
    assert old in text
    return text.replace(old, new)
