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
    import onnxruntime

    present = onnxruntime.get_available_providers()
    wanted = PROVIDERS.get(name, name)
    if wanted not in present:
        known = [short for short, long in PROVIDERS.items() if long in present]
        raise InputError(
            f"PROVIDER is {name!r}, but this onnxruntime {onnxruntime.__version__} has {', '.join(known)}: "
            "choose one of these, or install the onnxruntime package that has it"
        )
    return list(dict.fromkeys([wanted, PROVIDERS["cpu"]]))
