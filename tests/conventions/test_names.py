import pytest

from conventions.names import SampleName, file_stem


@pytest.mark.parametrize(
    ("name", "system", "number"),
    [
        ("globaldiff/full", "globaldiff/full", 1),
        ("globaldiff/full.s2", "globaldiff/full", 2),
        ("a.s2.s10", "a.s2", 10),
        ("reference", "reference", 1),
    ],
)
def test_a_sample_is_named_by_its_system_and_number(name, system, number):
    assert SampleName.parse(name) == SampleName(system, number)
    assert str(SampleName(system, number)) == name


@pytest.mark.parametrize("name", ["a.s1", "a.s0", "a.s02", ".s2", "a.s", "a.s2 ", "a.s\u0662"])
def test_what_no_later_sample_is_called_is_a_name_as_it_stands(name):
    assert SampleName.parse(name) == SampleName(name)


def test_files_have_the_names_of_systems_without_their_slash():
    assert file_stem("globaldiff/local") == "globaldiff-local"
