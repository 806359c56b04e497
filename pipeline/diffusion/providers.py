"""Execution providers: what onnxruntime runs a graph on, by the short names of the option PROVIDER.

The wheel `onnxruntime` has the CPU; others come in its stead (onnxruntime-gpu, onnxruntime-openvino,
onnxruntime-directml, ...). What a provider lacks, onnxruntime runs on the CPU.
"""

from __future__ import annotations

from pipeline.errors import InputError

PROVIDERS = {
    "cpu": "CPUExecutionProvider",
    "cuda": "CUDAExecutionProvider",
    "tensorrt": "TensorrtExecutionProvider",
    "rocm": "ROCMExecutionProvider",
    "migraphx": "MIGraphXExecutionProvider",
    "openvino": "OpenVINOExecutionProvider",
    "dml": "DmlExecutionProvider",
    "coreml": "CoreMLExecutionProvider",
}


def provider_chain(name: str) -> list[str]:
    """Return onnxruntime's names of a provider and of those it falls back on, in order.

    Raises InputError when this onnxruntime has no such provider; the text lists those it has.
    """
    version, known = present_providers()
    wanted = PROVIDERS.get(name, name)
    if name not in known and wanted not in [PROVIDERS[short] for short in known]:
        raise InputError(
            f"PROVIDER is {name!r}, but this onnxruntime {version} has {', '.join(known)}: "
            "choose one of these, or install the onnxruntime package that has it"
        )
    return list(dict.fromkeys([wanted, PROVIDERS["cpu"]]))


def present_providers() -> tuple[str, list[str]]:
    """Return the version of onnxruntime that is installed, and the short names of the providers it has."""
    import onnxruntime

    present = onnxruntime.get_available_providers()
    return onnxruntime.__version__, [short for short, long in PROVIDERS.items() if long in present]
