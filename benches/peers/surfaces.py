"""Iso-surface and fairing of a carved grid, with the tools that carved is compared with."""

import numpy as np

from timing import median_s


def flying_edges(volume_file, sd_um):
    """VTK's fastest marching cubes, on all cores, without normals. Returns seconds and triangles."""
    import vtk
    from vtk.util import numpy_support

    volume = np.load(volume_file)
    image = vtk.vtkImageData()
    # In C order z is fastest, in VTK x is fastest. The axes are exchanged, which does not affect the time.
    image.SetDimensions(volume.shape[::-1])
    image.SetSpacing(sd_um, sd_um, sd_um)
    image.GetPointData().SetScalars(numpy_support.numpy_to_vtk(volume.ravel(), deep=False))

    def extract():
        edges = vtk.vtkFlyingEdges3D()
        edges.SetValue(0, 0.5)
        edges.ComputeNormalsOff()
        edges.ComputeGradientsOff()
        edges.ComputeScalarsOff()
        edges.SetInputData(image)
        edges.Update()
        return edges.GetOutput().GetNumberOfPolys()

    return median_s(extract, 5)


def implicit_fairing(volume_file, sd_um):
    """Ten steps of (M - lambda L) v' = M v: libigl's cotangents and masses, scipy's conjugate gradients to 1e-6. Seconds and triangles."""
    import igl
    import scipy.sparse
    from scipy.sparse.linalg import cg
    from skimage.measure import marching_cubes

    vertices, triangles, _, _ = marching_cubes(np.load(volume_file), 0.5, spacing=(sd_um,) * 3)
    start, triangles = vertices.astype(np.float64), triangles.astype(np.int64)
    weight = 0.5 * sd_um**2

    def fair():
        v = start
        cotangents = igl.cotmatrix(v, triangles)
        for _ in range(10):
            masses = igl.massmatrix(v, triangles, igl.MASSMATRIX_TYPE_BARYCENTRIC)
            system = (masses - weight * cotangents).tocsr()
            scaling, wanted = scipy.sparse.diags(1 / system.diagonal()), masses @ v
            v = np.stack([cg(system, wanted[:, k], x0=v[:, k], rtol=1e-6, M=scaling)[0] for k in range(3)], axis=1)
        return len(triangles)

    return median_s(fair, 3, warm=False)
