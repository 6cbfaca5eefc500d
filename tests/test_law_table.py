"""The law table of this project: which tests hold which law, and that they run over every object that it is about."""

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from cases import (
    COMPENSATIONS,
    DISTILLATES,
    DISTRIBUTIONS,
    FRESNELS,
    HEAVY,
    MATERIALS,
    SCATTERINGS,
    SEGMENTS,
    TRACED,
    unnamed,
)

import torchms

TESTS = Path(__file__).parent

OBJECTS = {
    "distribution": set(DISTRIBUTIONS),
    "segment": set(SEGMENTS),
    "scattering": {*SCATTERINGS, *COMPENSATIONS, *DISTILLATES, *TRACED},
    "bsdf": {material.partition("[")[0] for material in MATERIALS},
    "fresnel": set(FRESNELS),
}
"""Column → the objects that its laws are about: keys of the tables of cases.py."""

ARGUMENTS = {
    "distribution": {"distribution": str, "family": lambda family: family.__name__.lower()},
    "segment": {"segment": str},
    "scattering": {"scattering": str, "estimator": str},
    "bsdf": {"material": lambda material: material.partition("[")[0]},
    "fresnel": {"material": lambda material: material.partition("[")[2].rstrip("]")},
}
"""Column → names of the arguments that tests are parametrized by, and what makes a key of a value."""

EXCUSED = {("limit", "distribution"): {*unnamed(torchms.MicrofacetDistribution)}}
"""Cells with objects to which the law does not apply: which parameters are roughnesses is said in a line of `cases`."""

SLOW = {
    ("export", "distribution"): {"gtr", "tabulated", *unnamed(torchms.MicrofacetDistribution)},
    ("gradient", "fresnel"): {*unnamed(torchms.fresnel.Fresnel)},
    ("export", "scattering"): {n for n in SCATTERINGS if n.startswith("bidirectional")}
    | {"uncorrelated", "turquin", *TRACED},
}
"""Cells whose objects only a slow test may hold: an export of these takes a minute."""

LAWS: dict[tuple[str, str], list[str]] = {
    ("normalisation", "distribution"): [
        "test_distributions::test_projected_normals_cover_the_surface",
        "test_distributions::test_visible_normals_are_a_density",
        "test_law_suite::test_distributions_obey",
        "test_tabulated::test_obeys = tabulated",
        "test_gtr::test_visible_normals_have_their_density = gtr",
    ],
    ("normalisation", "bsdf"): ["test_density::test_pdf_is_normalised_and_sample_follows_it"],
    ("chi²", "distribution"): [
        "test_tabulated::test_obeys = tabulated",
        "test_law_suite::test_distributions_obey",
        "test_distributions::test_visible_normals_have_their_density",
        "test_gtr::test_visible_normals_have_their_density = gtr",
    ],
    ("chi²", "bsdf"): [
        "test_density::test_pdf_is_normalised_and_sample_follows_it",
        "test_energy::test_walks_go_where_orders_say",
    ],
    ("chi²", "scattering"): [
        "test_energy::test_walks_go_where_orders_say",
        "test_compensation::test_orders_walks_and_energies_agree",
        "test_distilled::test_orders_walks_and_energies_agree",
        "test_surface_lobes::test_walks_carry_the_lobes",
    ],
    ("limit", "distribution"): [
        "test_distributions::test_equal_alphas_are_isotropic",
        "test_limit::test_equal_alphas_are_isotropic",
        "test_gtr::test_gamma_2_is_ggx = gtr",
        "test_tabulated::test_one_component_is_beckmann = tabulated",
    ],
    ("limit", "segment"): ["test_segment::test_one_bounce_is_G2"],
    ("limit", "scattering"): [
        "test_limit::test_one_order_is_a_single_bounce",
        "test_limit::test_equal_alphas_are_isotropic",
        "test_compensation::test_first_order_is_the_single_bounce",
        "test_distilled::test_first_order_is_the_single_bounce",
        "test_surface_lobes::test_equal_roughnesses_are_isotropic",
    ],
    ("symmetry", "distribution"): [
        "test_distributions::test_lambda_of_the_opposite_direction",
        "test_law_suite::test_distributions_obey",
        "test_properties::test_gtr_over_its_range = gtr",
        "test_tabulated::test_obeys = tabulated",
    ],
    ("symmetry", "segment"): [
        "test_segment::test_reversed_path",
        "test_path_integral::test_second_order_is_reciprocal",
    ],
    ("symmetry", "scattering"): [
        "test_reciprocity::test_reciprocity_in_expectation",
        "test_path_integral::test_second_order_is_reciprocal = correlated, bidirectional-correlated",
        "test_compensation::test_kulla_conty_is_reciprocal = kulla-conty",
        "test_compensation::test_turquin_is_not = turquin",
        "test_distilled::test_reciprocity_and_the_symmetries_of_the_surface",
        "test_surface_lobes::test_symmetries_of_the_surface",
    ],
    ("symmetry", "bsdf"): [
        "test_reciprocity::test_one_bounce_is_reciprocal",
        "test_reciprocity::test_reciprocity_in_expectation",
        "test_reciprocity::test_radiance_is_importance_over_eta_squared",
    ],
    ("symmetry", "fresnel"): ["test_reciprocity::test_one_bounce_is_reciprocal"],
    ("energy", "segment"): ["test_segment::test_escape_and_stay_sum_to_one"],
    ("energy", "scattering"): [
        "test_furnace::test_the_furnace_is_white",
        "test_furnace::test_one_bounce_is_dark = single",
        "test_compensation::test_the_furnace_is_white",
        "test_distilled::test_the_furnace_is_white",
        "test_surface_lobes::test_the_furnace_is_white",
    ],
    ("energy", "bsdf"): [
        "test_furnace::test_the_furnace_is_white",
        "test_energy::test_orders_walks_and_energies_agree",
    ],
    ("agreement", "distribution"): [
        "test_distributions::test_lambda_and_masking_are_the_integral_of_eq_4",
        "test_law_suite::test_distributions_obey",
        "test_distributions_mitsuba::test_density_of_normals = ggx, beckmann",
        "test_gtr::test_lambda_is_its_integral = gtr",
        "test_tabulated::test_obeys = tabulated",
    ],
    ("agreement", "segment"): ["test_path_integral::test_second_order_is_the_integral"],
    ("agreement", "scattering"): [
        "test_reference_energy::test_every_order_agrees",
        "test_reference_energy::test_the_first_order_is_the_quadrature",
        "test_path_integral::test_second_order_is_the_integral = uncorrelated, correlated, invariance",
        "test_bidirectional::test_walks_go_where_it_says = bidirectional-correlated, bidirectional-invariance",
        "test_bidirectional::test_walks_go_where_it_says = bidirectional-uncorrelated",
        "test_compensation::test_orders_walks_and_energies_agree",
        "test_distilled::test_lobes_are_those_of_the_exact_model",
        "test_surface_lobes::test_energies_are_those_of_the_traced_surface",
    ],
    ("agreement", "bsdf"): ["test_reference_energy::test_biased_models_conserve_energy"],
    ("gradient", "distribution"): [
        "test_distributions::test_gradients",
        "test_distributions::test_value_and_gradient_are_finite_everywhere",
        "test_finite_everywhere::test_a_few_rows",
        "test_gtr::test_gradients = gtr",
        "test_gtr::test_value_and_gradient_are_finite_everywhere = gtr",
        "test_tabulated::test_gradients = tabulated",
        "test_tabulated::test_the_mean_gradient_of_samples_is_that_of_the_mean = tabulated",
    ],
    ("gradient", "segment"): [
        "test_law_suite::test_segments_obey",
        "test_bidirectional::test_gradient_is_that_of_finite_differences",
    ],
    ("gradient", "scattering"): [
        "test_gradient::test_gradcheck_at_fixed_numbers",
        "test_gradient_mean::test_gradients_of_values",
        "test_finite::test_values_and_gradients_are_finite",
        "test_finite_everywhere::test_a_few_rows",
        "test_compensation::test_gradients_are_exact",
        "test_distilled::test_gradients_are_exact",
        "test_surface_lobes::test_gradients_are_exact",
    ],
    ("gradient", "bsdf"): [
        "test_gradient::test_gradcheck_at_fixed_numbers",
        "test_finite::test_values_and_gradients_are_finite",
    ],
    ("gradient", "fresnel"): [
        "test_fresnel::test_gradients_of_the_dielectric = dielectric",
        "test_law_suite::test_the_whole_table_obeys",
        "test_gradient::test_gradcheck_at_fixed_numbers",
        "test_compensation::test_values_and_gradients_are_finite",
    ],
    ("export", "distribution"): [
        "test_files::test_parity = ggx, beckmann",
        "test_gtr_export::test_a_file_is_eager = gtr",
        "test_files::test_parity_of_every_distribution",
    ],
    ("export", "scattering"): [
        "test_files::test_parity = single, correlated, height-walk",
        "test_files::test_parity_over_the_tables",
        "test_distilled_export::test_a_file_is_eager",
        "test_distilled_export::test_a_file_of_traced_lobes_is_eager",
    ],
    ("export", "bsdf"): ["test_files::test_parity = conductor, dielectric, diffuse"],
}
"""Law and column → the tests that hold it, and, after "=", the keys of one that is not parametrized by keys."""


def function(entry: str) -> Any:
    """The test function that an entry names."""
    module, _, name = entry.partition(" = ")[0].partition("::")
    (path,) = TESTS.rglob(f"{module}.py")
    if str(path.parent) not in sys.path:
        sys.path.insert(0, str(path.parent))
    return getattr(importlib.import_module(module), name)


def held(entry: str, column: str) -> Iterator[tuple[str, bool]]:
    """The keys that a test runs over, and whether in a slow case only."""
    marks = getattr(function(entry), "pytestmark", [])
    assert not any(mark.name in ("skip", "xfail") for mark in marks), f"{entry} does not run"
    always = any(mark.name == "slow" for mark in marks)
    for key in entry.partition(" = ")[2].split(", "):
        if key:
            yield key, always
    for mark in marks:
        if mark.name != "parametrize":
            continue
        names = [name.strip() for name in mark.args[0].split(",")]
        for case in mark.args[1]:
            values = getattr(case, "values", (case,) if len(names) == 1 else case)
            slow = always or any(m.name == "slow" for m in getattr(case, "marks", ()))
            for name, value in zip(names, values, strict=True):
                if name in ARGUMENTS[column]:
                    yield ARGUMENTS[column][name](value), slow


@pytest.mark.parametrize("law,column", LAWS)
def test_the_law_holds_for_every_object(law, column):
    """In a slow case at least, and in a quick one unless the object is heavy."""
    cases = [found for entry in LAWS[law, column] for found in held(entry, column)]
    objects = OBJECTS[column] - EXCUSED.get((law, column), set())
    missing = objects - {key for key, _ in cases}
    assert not missing, f"nothing holds {missing} to the law of {law}: see tests/cases.py"
    only_slow = objects - {key for key, slow in cases if not slow} - SLOW.get((law, column), set())
    assert only_slow <= HEAVY - set(DISTRIBUTIONS), f"only slow tests hold {only_slow} to the law of {law}"


@pytest.mark.parametrize("entry", sorted({entry for entries in LAWS.values() for entry in entries}))
def test_what_is_named_is_collected(entry):
    """A test function, whose explicit keys are keys."""
    assert callable(function(entry)) and function(entry).__name__.startswith("test_")
    known = set().union(*OBJECTS.values())
    assert {key for key in entry.partition(" = ")[2].split(", ") if key} <= known
